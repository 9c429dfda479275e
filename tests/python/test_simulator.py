import re

import numpy as np
import pytest

import evmarker
from conftest import joined
from evmarker import Simulator, handheld


def simulate(camera, markers, **settings):
    return joined(Simulator(camera, markers, duration_s=0.05, **settings))


def test_the_same_arguments_give_the_same_events(camera):
    events = simulate(camera, {7: handheld()})
    assert next(Simulator(camera, {7: handheld()})).dtype == evmarker.EVENT_DTYPE
    assert (np.diff(events["t"]) >= 0).all() and 0 <= events["t"][0] and events["t"][-1] < 50_000
    np.testing.assert_array_equal(events, simulate(camera, {7: handheld()}))
    assert not np.array_equal(events, simulate(camera, {7: handheld()}, seed=2))
    assert not np.array_equal(events, simulate(camera, {7: handheld(seed=2)}))
    assert not np.array_equal(events, simulate(camera, {8: handheld()}))


def test_a_trajectory_may_be_a_python_function(camera):
    motion = handheld(0.5, frequency_hz=3)
    np.testing.assert_array_equal(simulate(camera, {7: lambda s: motion(s)}), simulate(camera, {7: motion}))


def test_a_hand_sways_as_far_as_it_is_told():
    motion = handheld(0.5, amplitude_m=(0.1, 0, 0), amplitude_rad=(0, 0, 0))
    poses = np.array([motion(seconds) for seconds in np.linspace(0, 20, 2000)])
    assert 0.08 < np.abs(poses[:, 0, 3]).max() <= 0.1
    np.testing.assert_array_equal(poses[:, 1:3, 3] - [0, 0.5], np.zeros((2000, 2)))
    np.testing.assert_allclose(poses[:, :3, :3], np.broadcast_to(np.diag([1, -1, -1]), (2000, 3, 3)))


def test_settings_and_sensors(camera):
    quiet = {"amplitude_m": (0, 0, 0), "amplitude_rad": (0, 0, 0)}
    noise = simulate(camera, {7: handheld(**quiet)}, noise_hz_per_px=10)
    assert len(noise) == pytest.approx(10 * 0.05 * 640 * 480, rel=0.02)
    assert len(simulate(camera, {7: handheld(**quiet)}, noise_hz_per_px=0)) == 0
    assert len(simulate(camera, {7: handheld()}, sensor="dvs128")) < len(simulate(camera, {7: handheld()}))


def test_errors_of_a_trajectory_arrive(camera):
    def late_fault(seconds):
        if seconds > 0.01:
            raise KeyError("no such pose")
        return handheld()(seconds)

    with pytest.raises(KeyError, match="no such pose"):
        simulate(camera, {7: late_fault})


@pytest.mark.parametrize(
    "error, sentence, markers, settings",
    [
        (ValueError, "marker 7 is no array of 4 x 4 numbers", {7: lambda s: np.eye(3)}, {}),
        (ValueError, "marker 7 is no rotation and translation", {7: lambda s: np.full((4, 4), np.nan)}, {}),
        (ValueError, "marker 7 is no rotation and translation", {7: lambda s: 2 * np.eye(4)}, {}),
        (TypeError, "marker 7 is no function of the seconds", {7: np.eye(4)}, {}),
        (ValueError, "marker id 50 is not in DICT_4X4_50", {50: handheld()}, {}),
        (ValueError, 'sensor is "eye", not one of', {7: handheld()}, {"sensor": "eye"}),
        (ValueError, "simulator: noise_hz_per_px is -1", {7: handheld()}, {"noise_hz_per_px": -1}),
        (TypeError, "simulator: there is no setting noise", {7: handheld()}, {"noise": 1}),
        (TypeError, "simulator: leak_spread is no number", {7: handheld()}, {"leak_spread": "much"}),
    ],
)
def test_what_makes_no_sense_is_refused(camera, error, sentence, markers, settings):
    with pytest.raises(error, match=re.escape(sentence)):
        simulate(camera, markers, **settings)
