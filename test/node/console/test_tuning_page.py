"""Parameters of the tracker on the page."""

import pytest
import yaml

INACTIVE = "Without effect at present"


@pytest.fixture
def tuned(tracker, page):
    """A page with the tracker's parameters, every group open."""
    page.locator("#groups details").first.wait_for()
    page.evaluate("() => document.querySelectorAll('details').forEach(one => { one.open = true; })")
    return page


def field(page, name):
    return page.locator(f"[id='parameter-{name}']")


def enter(page, name, value):
    field(page, name).fill(value)
    field(page, name).press("Enter")


def group_of(page, name):
    return page.locator("#groups details", has=field(page, name)).get_attribute("data-group")


def refusal(page, name):
    return page.locator(f"[id='parameter-{name}-refusal']")


def test_every_parameter_of_the_node_has_a_field_with_its_description(tuned, client):
    names = client.parameter_names()
    assert len(names) > 30
    for name in names:
        assert field(tuned, name).count() == 1, name
    about = tuned.locator("[id='parameter-track.lost_after-about']").inner_text()
    assert about.startswith("The target counts as lost after it has been occluded for this time.")
    assert about.endswith("Allowed: 0 to 3600.")
    assert field(tuned, "autostart").is_disabled()


def test_a_value_out_of_range_is_refused_at_its_field_until_it_is_corrected(tuned, client):
    (before,) = client.get_parameters("track.lost_after")
    lost_after, shown = field(tuned, "track.lost_after"), refusal(tuned, "track.lost_after")

    def refuse():
        enter(tuned, "track.lost_after", "99999")
        tuned.wait_until(shown.inner_text, "refusal")

    def is_withdrawn():
        return shown.inner_text() == "" and float(lost_after.input_value()) == before

    refuse()
    reason = "parameter 'track.lost_after' is 99999.0; allowed: float, 0 to 3600"
    assert reason in shown.inner_text()
    assert shown.inner_text().endswith(f"; it stays {before}")
    assert lost_after.get_attribute("aria-invalid") == "true"
    assert client.get_parameters("track.lost_after") == [before]
    tuned.get_by_label("Reset track.lost_after").click()
    tuned.wait_until(is_withdrawn, "the value before, by its reset")
    refuse()
    enter(tuned, "particles", "321")
    tuned.wait_until(is_withdrawn, "the value before, by a change of another parameter")
    assert lost_after.get_attribute("aria-invalid") is None
    refuse()
    enter(tuned, "track.lost_after", "3")
    tuned.wait_until(lambda: client.get_parameters("track.lost_after") == [3.0], "new value")
    assert shown.inner_text() == ""


def test_a_slider_sets_its_value(tuned, client):
    slider = tuned.locator(".parameter", has=field(tuned, "resampling.threshold")).locator(
        "input[type=range]"
    )
    slider.fill("0.5")
    slider.dispatch_event("change")
    tuned.wait_until(lambda: client.get_parameters("resampling.threshold") == [0.5], "new value")
    assert field(tuned, "resampling.threshold").input_value() == "0.5"


def test_a_preset_changes_the_active_parameters_and_reset_restores_it(tuned, client):
    assert group_of(tuned, "proposal.share") == "Proposal"
    confidence = tuned.locator("#plot-confidence .slot p")
    assert confidence.inner_text().startswith("The probability that the box is on the target.")
    field(tuned, "preset").select_option("li2007")
    tuned.wait_until(lambda: "no probability" in confidence.inner_text(), "what it is then")
    tuned.wait_until(
        lambda: group_of(tuned, "color_histogram.sharpness") == "Color histogram", "its group"
    )
    assert group_of(tuned, "proposal.share") == INACTIVE
    enter(tuned, "particles", "77")
    tuned.wait_until(lambda: client.get_parameters("particles") == [77], "new value")
    tuned.locator("#reset").click()
    tuned.wait_until(lambda: client.get_parameters("particles") == [60], "the preset's value")
    tuned.wait_until(lambda: field(tuned, "particles").input_value() == "60", "it on the page")


def test_unfinished_input_survives_changes_by_others(tuned, client, console, open_page):
    other = open_page(console.url)
    other.locator("#groups details").first.wait_for()
    field(tuned, "track.lost_after").fill("7.5")
    client.set_parameters(preset="li2007")
    other.wait_until(lambda: group_of(other, "color_histogram.keep") != INACTIVE, "the other cues")
    assert field(tuned, "track.lost_after").input_value() == "7.5"
    field(tuned, "track.lost_after").press("Enter")
    tuned.wait_until(lambda: client.get_parameters("track.lost_after") == [7.5], "the input")
    tuned.wait_until(lambda: group_of(tuned, "color_histogram.keep") != INACTIVE, "the other cues")


def test_each_parameter_is_reset_by_itself(tuned, client):
    (default,) = client.get_parameters("track.lost_after")
    resets = tuned.locator("#groups .reset:visible")
    assert resets.count() == 0
    for name, value in {"particles": "321", "track.lost_after": "7.5"}.items():
        enter(tuned, name, value)
    tuned.wait_until(lambda: resets.count() == 2, "buttons beside what has changed")
    tuned.get_by_label("Reset track.lost_after").click()
    tuned.wait_until(lambda: client.get_parameters("track.lost_after") == [default], "its value")
    tuned.wait_until(lambda: resets.count() == 1, "one button less")
    assert client.get_parameters("particles") == [321]
    # The button disappears, and the focus goes to the field.
    focused = tuned.evaluate("() => document.activeElement.id")
    assert focused == "parameter-track.lost_after"
    # So are lists and choices.
    before = client.get_parameters("cues", "track.occlusion_policy")
    tuned.get_by_label("hog", exact=True).check()
    tuned.wait_until(lambda: client.get_parameters("cues") != before[:1], "other cues")
    tuned.get_by_label("Reset cues").click()
    field(tuned, "track.occlusion_policy").select_option("coast")
    tuned.get_by_label("Reset track.occlusion_policy").click()
    tuned.wait_until(
        lambda: client.get_parameters("cues", "track.occlusion_policy") == before, "those of before"
    )


def test_a_number_of_many_digits_is_rounded_and_has_a_full_title(tuned, client):
    exact = 1.0467401794744694e-08
    client.set_parameters(**{"template.update_above": exact})
    shown = field(tuned, "template.update_above")
    tuned.wait_until(lambda: shown.input_value() == "1.04674e-8", "the value, short")
    assert float(shown.get_attribute("title")) == exact
    # Focus alone changes nothing.
    shown.focus()
    shown.press("Tab")
    client.set_parameters(particles=123)
    tuned.wait_until(lambda: field(tuned, "particles").input_value() == "123", "the value")
    assert client.get_parameters("template.update_above") == [exact]


def test_changed_values_can_be_downloaded_as_a_parameter_file(tuned, client):
    client.set_parameters(particles=123, cues=["correlation_response"])
    tuned.wait_until(lambda: field(tuned, "particles").input_value() == "123", "the value")
    with tuned.expect_download() as download:
        tuned.locator("#yaml").click()
    assert download.value.suggested_filename == "tracker.yaml"
    given = yaml.safe_load(download.value.path().read_text())
    assert given == {
        "/pf_tracker": {
            "ros__parameters": {
                "preset": "default",
                "particles": 123,
                "cues": ["correlation_response"],
            }
        }
    }
