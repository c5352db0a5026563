"""The benchmarks of costs: what they fit, what counts as held, what they time."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def limits(benchmark):
    return benchmark("limits")


@pytest.mark.parametrize(
    ("value", "is_least", "is_met"),
    [(2.0, False, True), (2.1, False, False), (2.0, True, True), (1.9, True, False)],
)
def test_a_bar_is_met_up_to_its_bound(limits, value, is_least, is_met):
    limit = limits.Limit("cost", value, 2.0, is_least)
    assert limit.is_met is is_met
    (row,) = limits.limits_table([limit]).groups[0]
    assert row[-1] == ("met" if is_met else "**MISSED**")


@pytest.mark.parametrize("is_least", [False, True])
def test_a_bar_of_no_number_is_missed(limits, is_least):
    assert not limits.Limit("cost", math.nan, 2.0, is_least).is_met


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0])
def test_the_exponent_is_that_of_the_cost(benchmark, power):
    growth, setting = benchmark("kernel_stages.growth"), benchmark("kernel_stages.setting")
    costs = {
        setting.Setting(particles=count): growth.Cost(0.2 * count**power, 1.0)
        for count in setting.PARTICLES
    }
    assert growth.exponent(costs, "particles") == pytest.approx(power)
    assert math.isnan(growth.exponent(costs, "size"))


def test_every_stage_runs_on_every_kind_of_image(benchmark):
    stages, setting = benchmark("kernel_stages.stages"), benchmark("kernel_stages.setting")
    for kind in setting.KINDS:
        small = setting.Setting((320, 240), 20, 30, kind)
        for stage in stages.STAGES.values():
            timed = stage.make(small)
            timed.call(timed.prepare())
            stages.floor(stage, small).call(None)


def test_the_loop_over_particles_finds_the_target(benchmark):
    loop, setting = benchmark("kernel_stages.particle_loop"), benchmark("kernel_stages.setting")
    image = setting.street(320, 240)
    box = (100, 80, 40, 40)
    corners = np.array([(100 + x, 80 + y) for x in range(-9, 10, 3) for y in range(-9, 10, 3)])
    weights = loop.ParticleLoop(image, box).weights(image, corners)
    assert weights.sum() == pytest.approx(1.0)
    assert tuple(corners[weights.argmax()]) == (100, 80)


def test_the_smallest_update_makes_the_same_calls(tmp_path):
    # A process of its own, because it registers a cue.
    output = tmp_path / "new" / "python.md"
    command = [sys.executable, str(BENCHMARKS / "kernels.py"), "--only", "python", "--turns", "1"]
    subprocess.run([*command, "--output", str(output)], check=True, capture_output=True)
    told = "`python benchmarks/kernels.py --only python --turns 1 --output "
    assert output.read_text().startswith(told)
    rows = [line.strip("| ").split(" | ") for line in output.read_text().splitlines()]
    (usual,) = (int(row[-1]) for row in rows if row[0] == "an update")
    (least,) = (int(row[-1]) for row in rows if row[0].startswith("the same calls"))
    assert usual > 500
    assert least == pytest.approx(usual, rel=0.05)


def test_ages_and_losses_follow_from_the_answers(benchmark):
    pytest.importorskip("rclpy", reason="needs ROS 2")
    camera = benchmark("node_runs.camera")
    answers = camera.ResponseTimes(
        published={1: 10.0, 2: 10.1, 3: 10.2},
        box_received={1: 10.02, 3: 10.25},
        status_received={1: 10.03, 3: 10.26},
        processing={1: 0.01, 3: 0.02},
    )
    assert answers.latencies == pytest.approx([20.0, 50.0])
    assert answers.ages_when_begun == pytest.approx([20.0, 40.0])
    assert answers.frame_loss_rate == pytest.approx(1 / 3)
    first = camera.Sample(0, 5.0, [100.0], [1.0])
    run = camera.Run([answers], [first, camera.Sample(100, 10.0, [600.0], [1.0])])
    assert run.cpu_a_frame == [5.0]
    assert run.cpu_shares == [0.1]
