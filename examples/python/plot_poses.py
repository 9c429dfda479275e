#!/usr/bin/env python3
"""Tracks the markers of a recording and plots where they are over time.

Exit codes: 0 done, 1 error, 2 no marker was found.
"""

import argparse
import os
import sys

import evmarker
import numpy as np


class Parser(argparse.ArgumentParser):
    def error(self, message):
        raise ValueError(f"{message} (see --help)")


def parse():
    formatter = argparse.RawDescriptionHelpFormatter
    parser = Parser(prog="plot_poses", description=__doc__, formatter_class=formatter)
    parser.add_argument("recording", help="of any kind that track_file reads")
    parser.add_argument("--camera", required=True, help="calibration: OpenCV or ROS YAML")
    parser.add_argument("--dictionary", help="OpenCV's name; default: DICT_4X4_50")
    parser.add_argument("--marker-length", type=float, required=True, help="side of the black square [m]")
    parser.add_argument("--output", default="poses.png", help="picture to write: png, pdf or svg; default: %(default)s")
    options = parser.parse_args()
    for path in (options.recording, options.camera):
        if os.path.exists(options.output) and os.path.samefile(path, options.output):
            raise ValueError(f"{options.output} is also read: give --output another name")
    return options


def track(options):
    camera = evmarker.load_calibration(options.camera)
    tracker = evmarker.Tracker(camera, options.dictionary, options.marker_length)
    recording = evmarker.read(options.recording, sensor_size=camera.sensor_size)
    poses = np.concatenate([np.empty(0, evmarker.POSE_DTYPE), *map(tracker.push, recording)])
    return poses[poses["state"] == "tracking"]


def plot(poses, output):
    import matplotlib

    matplotlib.use("Agg")  # needs no screen
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 1, sharex=True, figsize=(8, 6), layout="constrained")
    for marker in np.unique(poses["marker_id"]):
        of_marker = poses[poses["marker_id"] == marker]
        seconds = 1e-6 * of_marker["t_us"]
        for name in ("tx", "ty", "tz"):
            axes[0].plot(seconds, of_marker[name], label=f"{name} of marker {marker}")
        axes[1].plot(seconds, of_marker["sigma_t_mm"], label=f"marker {marker}")
    axes[0].set_ylabel("position [m], camera frame")
    axes[1].set_ylabel("standard deviation [mm]")
    axes[1].set_xlabel("time [s]")
    for axis in axes:
        axis.legend()
        axis.grid(True)
    part = output + ".part"  # whole under its name, or not there
    figure.savefig(part, format=os.path.splitext(output)[1][1:] or "png")
    os.replace(part, output)


def main():
    try:
        options = parse()
        poses = track(options)
        if len(poses) == 0:
            print("plot_poses: no marker was found", file=sys.stderr)
            return 2
        plot(poses, options.output)
        print(f"{options.output}: {len(poses)} poses")
        return 0
    except ImportError:
        print("plot_poses: matplotlib is missing (Debian's python3-matplotlib)", file=sys.stderr)
    except (OSError, ValueError) as error:
        print(f"plot_poses: {error}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
