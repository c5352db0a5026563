import zipfile
from dataclasses import replace

import pytest

from pf_tracker_ros.formats import FORMATS, BoxTrack, FormatError, LabeledBox, RecordingInfo
from pf_tracker_ros.formats import read_tracks as read
from pf_tracker_ros.formats.tracks import interpolated, with_keyframes

# As CVAT exports a job: every frame, also interpolated ones, but none while a target is outside.
EXPORT = """<?xml version="1.0" encoding="utf-8"?>
<annotations>
  <version>1.1</version>
  <meta>
    <task>
      <id>12</id>
      <name>drive</name>
      <size>10</size>
      <mode>interpolation</mode>
      <start_frame>0</start_frame>
      <stop_frame>9</stop_frame>
      <labels><label><name>car</name><attributes></attributes></label></labels>
      <original_size><width>640</width><height>480</height></original_size>
    </task>
    <dumped>2024-05-02 10:00:00+00:00</dumped>
  </meta>
  <track id="0" label="car" source="manual">
    <box frame="2" keyframe="1" outside="0" occluded="0" xtl="10.00" ytl="20.50" xbr="30.00" ybr="50.00" z_order="0">
      <attribute name="color">red</attribute>
    </box>
    <box frame="3" keyframe="0" outside="0" occluded="0" xtl="11.00" ytl="20.50" xbr="31.00" ybr="50.00" z_order="0">
    </box>
    <box frame="4" keyframe="1" outside="1" occluded="0" xtl="12.00" ytl="20.50" xbr="32.00" ybr="50.00" z_order="0">
    </box>
    <box frame="7" keyframe="1" outside="0" occluded="1" xtl="40.00" ytl="20.00" xbr="60.00" ybr="40.00" z_order="0">
    </box>
  </track>
</annotations>
"""  # noqa: E501
BOX = 'frame="0" outside="0" occluded="0" keyframe="1" xtl="0" ytl="0" xbr="9" ybr="9"'


def file_of(tmp_path, *boxes, track='id="3" label="car"'):
    path = tmp_path / "drive.xml"
    inner = "".join(f"<box {box}></box>" for box in boxes)
    path.write_text(f"<annotations><track {track}>{inner}</track></annotations>")
    return path


@pytest.fixture(params=["xml", "zip"])
def export(request, tmp_path):
    """The export, alone and in the archive that CVAT makes."""
    path = tmp_path / f"drive.{request.param}"
    if request.param == "xml":
        path.write_text(EXPORT)
    else:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("annotations.xml", EXPORT)
    return path


def test_an_export_is_read(export):
    (track,) = read(export)
    assert (track.id, track.label) == (0, "car")
    assert {frame: labeled.box for frame, labeled in track.boxes.items()} == {
        2: (10.0, 20.5, 20.0, 29.5),
        3: (11.0, 20.5, 20.0, 29.5),
        4: None,
        7: (40.0, 20.0, 20.0, 20.0),
    }
    assert [labeled.is_keyframe for labeled in track.boxes.values()] == [True, False, True, True]
    assert track.boxes[7].occluded
    truth = track.ground_truth(10)
    assert [frame for frame in range(10) if truth[frame, 0] > 0] == [2, 3, 7]


def test_between_keyframes_boxes_are_interpolated(tmp_path):
    last = 'frame="4" outside="0" occluded="0" keyframe="1" xtl="8" ytl="4" xbr="25" ybr="13"'
    (track,) = read(file_of(tmp_path, BOX, last))
    # A quarter of the way, by hand.
    assert track.boxes[1].box == (2.0, 1.0, 11.0, 9.0)
    assert not track.boxes[1].is_keyframe


def test_a_rotated_box_is_read_as_its_bounding_box(tmp_path):
    box = BOX.replace('xbr="9" ybr="9"', 'xbr="8" ybr="4" rotation="90"')
    (track,) = read(file_of(tmp_path, box))
    assert track.boxes[0].box == pytest.approx((2.0, -2.0, 4.0, 8.0))


def test_cvat_shows_nearly_the_written_boxes(tmp_path):
    """CVAT keeps the keyframes only, and interpolates between them."""
    boxes = {
        frame: LabeledBox((frame**2 / 10, 3.0 * frame, 40.0 + frame % 3, 50.0), is_keyframe=False)
        for frame in range(60)
    }
    FORMATS["cvat"]["boxes.cvat.xml"](
        tmp_path / "a.xml", [BoxTrack(1, "", boxes)], RecordingInfo("a.mp4", 90, {0: (640, 480)})
    )
    (track,) = read(tmp_path / "a.xml")
    keyframes = {frame: one for frame, one in track.boxes.items() if one.is_keyframe}
    assert len(keyframes) < 15
    shown = interpolated(keyframes)
    for frame, labeled in boxes.items():
        # 5 % of the smaller side at each corner.
        assert shown[frame].box == pytest.approx(labeled.box, abs=2 * 0.05 * 42.0)
    # The target has ended.
    assert shown[60].box is None


def test_given_keyframes_stay_keyframes():
    boxes = {frame: LabeledBox((0.0, 0.0, 9.0, 9.0), is_keyframe=frame == 5) for frame in range(9)}
    assert [f for f, one in with_keyframes(boxes).items() if one.is_keyframe] == [0, 5, 8]
    moved = boxes | {4: replace(boxes[4], box=(3.0, 0.0, 9.0, 9.0))}
    assert [f for f, one in with_keyframes(moved).items() if one.is_keyframe] == [0, 3, 4, 5, 8]


ENTITIES = '<!DOCTYPE a [<!ENTITY b "x"><!ENTITY c "&b;&b;">]><annotations>&c;</annotations>'


def test_two_boxes_in_a_few_bytes_do_not_fill_the_memory(tmp_path):
    corners = 'xtl="1" ytl="1" xbr="9" ybr="9"'
    path = file_of(tmp_path, f'frame="0" {corners}', f'frame="99999999" {corners}')
    with pytest.raises(FormatError, match="more than 10000000 frames lie between the boxes"):
        read(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ENTITIES, "DOCTYPE"),
        ('<!DOCTYPE a SYSTEM "file:///etc/passwd"><annotations/>', "DOCTYPE"),
        ("<annotations><track>", "cannot be read as XML"),
        ('<?xml version="1.0" encoding="none"?><annotations/>', "cannot be read as XML"),
        ("<html></html>", "root element <html>"),
        ("<annotations/>", "no <track>"),
        ('<annotations><image id="0"/></annotations>', "<image> elements; in CVAT, export as"),
        ('<annotations><track id="1"><polygon/></track></annotations>', "1 has a <polygon>; allow"),
        ('<annotations><track id="x"><box frame="0"/></track></annotations>', "'id' is 'x'"),
        ('<annotations><track id="1"/></annotations>', "no box"),
    ],
)
def test_other_documents_are_refused(tmp_path, text, message):
    path = tmp_path / "drive.xml"
    path.write_text(text)
    with pytest.raises(FormatError, match=message) as refusal:
        read(path)
    assert str(path) in str(refusal.value)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("xbr", "nan"), "frame 0: 'xbr' is 'nan'"),
        (("xbr", "-4"), "frame 0: the box is -4 x 9 px"),
        (("frame", "1.5"), "track 3, <box>: 'frame' is '1.5'"),
        (("keyframe", "yes"), "'keyframe' is 'yes'; allowed: 0 or 1"),
        (("none", ""), "frame 0: it is there twice"),
    ],
)
def test_wrong_boxes_are_refused_with_their_place(tmp_path, wrong, message):
    name, value = wrong
    box = " ".join(
        f'{name}="{value}"' if each.startswith(f"{name}=") else each for each in BOX.split()
    )
    with pytest.raises(FormatError, match=message):
        read(file_of(tmp_path, *[box] * (2 if name == "none" else 1)))


def test_an_archive_without_annotations_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("readme.txt", "")
    with pytest.raises(FormatError, match=r"no annotations\.xml"):
        read(tmp_path / "a.zip")
    (tmp_path / "b.zip").write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(FormatError, match="cannot be read as XML"):
        read(tmp_path / "b.zip")
