import re
import sys
import threading

import numpy as np
import pytest

import evmarker
from conftest import PAGES, joined, run, table


def require_equal(poses, columns):
    """But for what a compiler may round otherwise in a module than in a program: 1e-12 measured, if at all."""
    assert poses.dtype.names[: len(columns)] == tuple(columns)
    for name, column in columns.items():
        if column.dtype == float:
            np.testing.assert_allclose(poses[name], column, rtol=1e-9, atol=1e-12, err_msg=name)
        else:
            np.testing.assert_array_equal(poses[name], column, err_msg=name)


def test_poses_are_those_of_track_file(folder, poses):
    assert len(poses) > 1000
    require_equal(poses, table(folder / "poses.csv"))


def test_poses_do_not_depend_on_how_events_are_divided(camera, events, poses):
    tracker = evmarker.Tracker(camera, "DICT_4X4_50", 0.1)
    parts = np.split(events, [1, 2, 1000, 20000, 20000])
    np.testing.assert_array_equal(np.concatenate([tracker.push(part) for part in parts]), poses)


def test_matrices_say_what_the_columns_say(poses):
    last = poses[-1]
    T, P = last["T_camera_marker"], last["covariance"]
    x, y, z, w = (last[name] for name in ("qx", "qy", "qz", "qw"))
    R = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    np.testing.assert_allclose(T[:3, :3], R, atol=1e-12)
    np.testing.assert_array_equal(T[:3, 3], [last["tx"], last["ty"], last["tz"]])
    np.testing.assert_array_equal(T[3], [0, 0, 0, 1])
    np.testing.assert_allclose(P, P.T, rtol=1e-12)
    assert np.linalg.eigvalsh(P).min() > 0
    assert 1e3 * np.sqrt(P[0, 0] + P[1, 1] + P[2, 2]) == pytest.approx(last["sigma_t_mm"])
    assert np.degrees(np.sqrt(P[3, 3] + P[4, 4] + P[5, 5])) == pytest.approx(last["sigma_r_deg"])


def test_a_stated_latency_moves_poses_forward_and_its_deviation_widens_the_covariance(camera, events, poses):
    late = evmarker.Tracker(camera, "DICT_4X4_50", 0.1, latency_us=2000, latency_sigma_us=1000).push(events)
    assert len(late) == len(poses)
    v = np.stack([poses[name] for name in ("vx", "vy", "vz")], axis=1)
    moved = late["T_camera_marker"][:, :3, 3] - poses["T_camera_marker"][:, :3, 3]
    assert np.linalg.norm(v, axis=1).max() > 0.1
    np.testing.assert_allclose(moved, 2e-3 * v, atol=1e-9)
    widened = late["covariance"][:, :3, :3] - poses["covariance"][:, :3, :3]
    expected = (1e-3**2 - 1e-4**2) * v[:, :, None] * v[:, None, :]
    np.testing.assert_allclose(widened, expected, atol=1e-6 * np.abs(expected).max())


def motion(seconds):
    """A marker that faces the camera, upright, and moves on an ellipse."""
    T = np.diag([1.0, -1, -1, 1])
    T[:3, 3] = 0.05 * np.sin(9 * seconds), 0.04 * np.cos(7 * seconds), 0.6 + 0.02 * np.sin(5 * seconds)
    return T


def test_poses_are_near_the_truth(camera):
    tracker = evmarker.Tracker(camera, "DICT_4X4_50", {3: 0.08})
    simulator = evmarker.Simulator(camera, {3: motion}, 0.08, duration_s=0.3)
    poses = np.concatenate([tracker.push(events) for events in simulator])
    poses = poses[poses["state"] == "tracking"]
    assert set(poses["marker_id"]) == {3}
    truth = np.array([motion(1e-6 * t) for t in poses["t_us"]])
    error_mm = 1e3 * np.linalg.norm(poses["T_camera_marker"][:, :3, 3] - truth[:, :3, 3], axis=1)
    assert error_mm.mean() < 0.25
    traces = np.einsum("nij,nij->n", poses["T_camera_marker"][:, :3, :3], truth[:, :3, :3])
    assert np.degrees(np.arccos(np.clip((traces - 1) / 2, -1, 1))).mean() < 0.3

    now = tracker.poses_at(302_000)  # 2 ms behind the end
    assert now["t_us"] == [302_000]
    assert 1e3 * np.linalg.norm(now["T_camera_marker"][0, :3, 3] - motion(0.302)[:3, 3]) < 1
    # No event in 20 ms: it has stopped, and is known as well as before.
    rest = tracker.poses_at(320_000)
    assert 1e3 * np.linalg.norm(rest["T_camera_marker"][0, :3, 3] - now["T_camera_marker"][0, :3, 3]) < 1
    assert 0.5 * now["sigma_t_mm"] < rest["sigma_t_mm"] < 2 * now["sigma_t_mm"]


def in_dtype(**fields):
    """A function that copies events to an array with these fields."""

    def convert(events):
        names = {"timestamp": "t", "polarity": "p"}
        other = np.zeros(len(events), [(name, dtype) for name, dtype in fields.items()])
        for name in set(fields) - {"id"}:
            other[name] = events[names.get(name, name)]
        return other

    return convert


def misaligned(events):
    return np.frombuffer(b"." + events.tobytes(), events.dtype, offset=1)


METAVISION = np.dtype([("x", "u2"), ("y", "u2"), ("p", "i2"), ("t", "i8")], align=True)

LAYOUTS = {
    "of Metavision": lambda events: events.astype(METAVISION),
    "packed": in_dtype(x="u2", y="u2", p="i2", t="i8"),
    "another order": in_dtype(t="i8", p="i2", y="u2", x="u2"),
    "wide": in_dtype(x="i8", y="u4", t="u8", p="i1"),
    "narrow": in_dtype(x="i4", y="i2", t="i4", p="?"),
    "further fields": in_dtype(id="i4", x="u2", y="u2", p="i2", t="i8"),
    "of dv-processing": in_dtype(timestamp="i8", x="i2", y="i2", polarity="u1"),
    "with gaps": lambda events: np.repeat(events, 2)[::2],
    "backwards": lambda events: events[::-1].copy()[::-1],
    "misaligned": misaligned,
}


@pytest.mark.parametrize("convert", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_any_layout_gives_the_same_poses(camera, events, poses, convert):
    tracker = evmarker.Tracker(camera, "DICT_4X4_50", 0.1)
    np.testing.assert_array_equal(tracker.push(convert(events)), poses)


def test_columns_give_the_same_poses(camera, events, poses):
    tracker = evmarker.Tracker(camera, "DICT_4X4_50", 0.1)
    sign = np.where(events["p"] > 0, 1, -1)
    columns = {"x": events["x"].astype("i4"), "y": events["y"], "t": events["t"], "p": sign}
    np.testing.assert_array_equal(tracker.push(**columns), poses)


def test_events_off_the_sensor_are_counted(camera):
    tracker = evmarker.Tracker(camera, "DICT_4X4_50", 0.1)
    tracker.push(x=np.array([-1, 640, 70000, 65536 + 3]), y=np.zeros(4, int), t=np.arange(4), p=np.ones(4, int))
    assert tracker.statistics["off_sensor"] == 4


COLUMN = np.zeros(3, int)
WRONG = {
    "list is no NumPy array": ([1, 2], TypeError),
    "float64 has no field x": (np.zeros(3), ValueError),
    "has no field t; there must be x, y, t and p": (np.zeros(3, [("x", "u2"), ("y", "u2"), ("p", "i2")]), ValueError),
    "x has 2 dimensions": (np.zeros((2, 2), evmarker.EVENT_DTYPE), ValueError),
    "x has 0 dimensions": (np.zeros((), evmarker.EVENT_DTYPE), ValueError),
    "t is of type float64": (in_dtype(x="u2", y="u2", t="f8", p="i2")(np.zeros(3, evmarker.EVENT_DTYPE)), ValueError),
    "x is of type >u2": (in_dtype(x=">u2", y="u2", t="i8", p="i2")(np.zeros(3, evmarker.EVENT_DTYPE)), ValueError),
    "y has 2 numbers, x has 3": ({"x": COLUMN, "y": COLUMN[:2], "t": COLUMN, "p": COLUMN}, ValueError),
    "p is of type object": ({"x": COLUMN, "y": COLUMN, "t": COLUMN, "p": COLUMN.astype(object)}, ValueError),
}


@pytest.mark.parametrize("sentence", WRONG)
def test_wrong_arrays_are_refused(camera, sentence):
    tracker = evmarker.Tracker(camera, "DICT_4X4_50", 0.1)
    wrong, error = WRONG[sentence]
    with pytest.raises(error, match="^events: .*" + re.escape(sentence)) as raised:
        tracker.push(**wrong) if isinstance(wrong, dict) else tracker.push(wrong)
    assert "\n" not in str(raised.value)
    assert tracker.statistics["events"] == 0


@pytest.mark.parametrize(
    "sentence, arguments",
    [
        ("marker_length is missing", {}),
        ('dictionary: no "DICT_3X3"', {"dictionary": "DICT_3X3", "marker_length": 0.1}),
        ("must be a positive number of metres, not -1", {"marker_length": -1}),
        ("marker id 50 is not in DICT_4X4_50", {"marker_length": {50: 0.1}}),
        ("marker_length names no marker", {"marker_length": {}}),
        ("ids are of markers that need a marker_length", {"boards": "board.yml", "ids": [1]}),
        ("marker 4 of ids has no marker_length", {"marker_length": {3: 0.1}, "ids": [3, 4]}),
        ("board none.yml: cannot be read", {"boards": "none.yml"}),
        ("events_per_update is -1", {"marker_length": 0.1, "events_per_update": -1}),
        ("latency_s is -1", {"marker_length": 0.1, "latency_us": -1e6}),
        ("latency_sigma_s is 0", {"marker_length": 0.1, "latency_sigma_us": 0}),
    ],
)
def test_what_makes_no_sense_is_a_value_error(camera, sentence, arguments):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        evmarker.Tracker(camera, **arguments)


def test_cameras(folder, camera):
    assert camera.sensor_size == (640, 480)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (533, 533, 319.5, 239.5)
    with pytest.raises(ValueError, match="^calibration .*none.yml: cannot be read"):
        evmarker.load_calibration(folder / "none.yml")
    with pytest.raises(ValueError, match="^camera: fx is -1$"):
        evmarker.PinholeCamera((640, 480), -1, 533, 319.5, 239.5)
    with pytest.raises(ValueError, match="^camera: fisheye has 3 numbers, not 4: k1 k2 k3 k4$"):
        evmarker.PinholeCamera((640, 480), 533, 533, 319.5, 239.5, fisheye=[0, 0, 0])


def test_calibrations_of_several_cameras_and_without_a_size(tmp_path):
    camera = "  camera_model: pinhole\n  intrinsics: [%d, 301, 160, 120]\n  resolution: [346, 260]\n"
    lens = "  distortion_model: radtan\n  distortion_coeffs: [0, 0, 0, 0]\n"
    (tmp_path / "chain.yaml").write_text("cam0:\n" + camera % 300 + lens + "cam1:\n" + camera % 310 + lens)
    (tmp_path / "calib.txt").write_text("299 301 120 90 0 0 0 0 0\n")
    assert evmarker.load_calibration(tmp_path / "chain.yaml", "cam1").fx == 310
    assert evmarker.load_calibration(tmp_path / "calib.txt", size=(240, 180)).fx == 299
    with pytest.raises(ValueError, match="cam0, cam1"):
        evmarker.load_calibration(tmp_path / "chain.yaml")


def test_lens_distortion_bends_the_image():
    """A point half a focal length beside the axis, by the formulae of OpenCV's documentation."""
    radtan, fisheye = {"radtan": [0.2, 0, 0, 0]}, {"fisheye": [0, 0, 0, 0]}
    for lens, factor in (({}, 1), (radtan, 1 + 0.2 * 0.25), (fisheye, 2 * np.arctan(0.5))):
        camera = evmarker.PinholeCamera((640, 480), 400, 400, 319.5, 239.5, **lens)
        T = np.diag([1.0, -1, -1, 1])
        T[:3, 3] = 0.3, 0, 0.6
        shaking = lambda s: T + 1e-3 * np.sin(300 * s) * np.eye(4, k=3)
        events = joined(evmarker.Simulator(camera, {0: shaking}, 0.01, duration_s=0.1, noise_hz_per_px=0))
        assert events["x"].mean() == pytest.approx(319.5 + 200 * factor, abs=1.5)


def test_boards_are_those_of_track_file(folder):
    board = ("--board", PAGES.parent / "cube.yml")
    run("simulate", "cube.raw", *board, "--distance", 0.3, "--duration", 0.1, folder=folder)
    run("track_file", "cube.raw", "--camera", "cube.yml", *board, "--output", "cube.csv", folder=folder)
    tracker = evmarker.Tracker(evmarker.load_calibration(folder / "cube.yml"), boards=PAGES.parent / "cube.yml")
    poses = np.concatenate([tracker.push(events) for events in evmarker.read(folder / "cube.raw")])
    assert len(poses) > 100
    require_equal(poses, table(folder / "cube.csv"))


def test_a_board_that_is_seen_otherwise_than_its_file_says_is_refused_with_a_warning(folder):
    def write(name, x):
        markers = "".join(
            f"  - {{ id: {id}, length: 0.05, rotation: [0, 0, 0], translation: [{sign * x}, 0, 0] }}\n"
            for id, sign in ((1, -1), (2, 1))
        )
        (folder / name).write_text(f"dictionary: DICT_4X4_50\nboard: 100\nmarkers:\n{markers}")
        return folder / name

    right, wrong = write("right.yml", 0.035), write("wrong.yml", 0.05)
    run("simulate", "two.raw", "--board", right, "--distance", 0.4, "--duration", 0.1, folder=folder)
    camera = evmarker.load_calibration(folder / "two.yml")
    events = joined(evmarker.read(folder / "two.raw"))
    assert len(evmarker.Tracker(camera, boards=right).push(events)) > 100
    with pytest.warns(UserWarning, match="board 100 does not fit its file: marker "):
        assert len(evmarker.Tracker(camera, boards=wrong).push(events)) == 0


def test_ids_and_lengths_choose_the_markers(camera):
    markers = {id: evmarker.handheld(seed=id, amplitude_m=(0.01, 0.01, 0.01)) for id in (3, 4)}
    right = lambda seconds: markers[4](seconds) + 0.15 * np.eye(4, k=3)
    events = joined(evmarker.Simulator(camera, {3: markers[3], 4: right}, 0.08, duration_s=0.1))
    for found, options in (
        ({3, 4}, {"marker_length": 0.08}),
        ({4}, {"marker_length": 0.08, "ids": [4]}),
        ({3}, {"marker_length": {3: 0.08}}),
    ):
        poses = evmarker.Tracker(camera, **options).push(events)
        assert set(poses["marker_id"]) == found


def test_other_threads_run_while_events_are_tracked(camera):
    """Python itself gives no other thread a turn here, and NumPy none where there are no poses to copy."""
    random = np.random.default_rng(1)
    noise = np.zeros(100_000, evmarker.EVENT_DTYPE)
    noise["x"], noise["y"] = random.integers(640, size=len(noise)), random.integers(480, size=len(noise))
    calls, most, others_ran = 0, 200, threading.Event()
    tracker = evmarker.Tracker(camera, "DICT_4X4_50", 0.1)

    def push_again_and_again():
        nonlocal calls
        while calls < most and not others_ran.is_set():
            tracker.push(noise)
            calls += 1

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1000)
    try:
        thread = threading.Thread(target=push_again_and_again)
        thread.start()
        others_ran.set()
        thread.join()
    finally:
        sys.setswitchinterval(interval)
    assert calls < most


def test_threads_may_share_a_tracker(camera, events):
    tracker = evmarker.Tracker(camera, "DICT_4X4_50", 0.1)
    threads = [threading.Thread(target=tracker.push, args=(events,)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert tracker.statistics["events"] == 4 * len(events)
