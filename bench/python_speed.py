#!/usr/bin/env python3
"""How fast events are tracked from Python, as a share of the speed in C++, on arrays of ten thousand events.

Run with the Python of the virtual environment in which the module is, beside a finished build of preset `release`:
  venv/bin/python bench/python_speed.py --build build/release
"""

import argparse
import pathlib
import statistics
import subprocess
import tempfile
import time

import evmarker
import numpy as np

ARRAY_EVENTS = 10_000


def seconds_in_python(camera, events):
    tracker = evmarker.Tracker(camera, "DICT_4X4_50", 0.1)
    begin = time.perf_counter()
    for first in range(0, len(events), ARRAY_EVENTS):
        tracker.push(events[first : first + ARRAY_EVENTS])
    return time.perf_counter() - begin


def layouts(events):
    yield "EVENT_DTYPE", events
    other = np.empty(len(events), [("t", "i8"), ("x", "i4"), ("y", "i4"), ("p", "?")])
    for name in other.dtype.names:
        other[name] = events[name]
    yield "another dtype", other


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default="build/release", help="default: %(default)s")
    parser.add_argument("--pairs", type=int, default=15, help="runs of both in turn; default: %(default)s")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        recording, calibration = f"{folder}/marker.raw", f"{folder}/marker.yml"
        subprocess.run([options.build / "examples/simulate", recording, "--duration", "1", "--quiet"], check=True)
        camera = evmarker.load_calibration(calibration)
        events = np.concatenate(list(evmarker.read(recording))).astype(evmarker.EVENT_DTYPE)
        in_cpp = [options.build / "bench/tracker_speed", recording, "--camera", calibration]
        in_cpp += ["--array-events", str(ARRAY_EVENTS)]
        for name, array in layouts(events):
            pairs = []
            for _ in range(options.pairs):
                seconds = float(subprocess.run(in_cpp, check=True, capture_output=True, text=True).stdout)
                pairs.append((seconds, seconds_in_python(camera, array)))
            shares = [cpp / python for cpp, python in pairs]
            rates = [1e-6 * len(events) / statistics.median(seconds) for seconds in zip(*pairs)]
            print(
                f"{name}: {rates[1]:.2f} M events/s in Python, {rates[0]:.2f} in C++; "
                f"share {statistics.median(shares):.3f} (from {min(shares):.3f} to {max(shares):.3f})"
            )


if __name__ == "__main__":
    main()
