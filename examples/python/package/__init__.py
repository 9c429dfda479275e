"""Tracks fiducial markers in 6 degrees of freedom, event by event, with an event camera.

Events are structured NumPy arrays of EVENT_DTYPE: x, y [px], p (above 0: brighter), t [us]. Poses are of POSE_DTYPE:
the columns of track_file's poses.csv, T_camera_marker (4, 4) [m], and the covariance (6, 6) of translation [m] and
rotation [rad] in the camera frame. What makes no sense raises ValueError with a sentence that names it.
"""

from ._evmarker import (
    EVENT_DTYPE,
    POSE_DTYPE,
    PinholeCamera,
    Reader,
    Simulator,
    Tracker,
    Trajectory,
    __version__,
    handheld,
    load_calibration,
    read,
)

__all__ = [
    "EVENT_DTYPE",
    "POSE_DTYPE",
    "PinholeCamera",
    "Reader",
    "Simulator",
    "Tracker",
    "Trajectory",
    "handheld",
    "load_calibration",
    "read",
]
