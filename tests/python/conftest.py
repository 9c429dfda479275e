"""Recordings that the programs make, once for all tests."""

import csv
import os
import pathlib
import subprocess

import numpy as np
import pytest

import evmarker

PROGRAMS = pathlib.Path(os.environ["EVMARKER_PROGRAMS"])
PAGES = pathlib.Path(__file__).parents[2] / "examples" / "python"


def run(program, *arguments, folder):
    command = [PROGRAMS / program, *map(str, arguments), "--quiet"]
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)


def table(path):
    """The columns of a pose table by name, words as text and the rest as numbers."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return {name: c if name in ("state", "loss_reason") else c.astype(float) for name, c in columns.items()}


def joined(arrays):
    """All events of an iterator; np.concatenate alone gives a dtype without gaps."""
    return np.concatenate([np.empty(0, evmarker.EVENT_DTYPE), *arrays]).astype(evmarker.EVENT_DTYPE)


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """With marker.raw, its calibration and what track_file makes of it."""
    folder = tmp_path_factory.mktemp("recordings")
    run("simulate", "marker.raw", "--ids", 7, "--duration", 0.3, folder=folder)
    marker = ("--camera", "marker.yml", "--marker-length", 0.1)
    run("track_file", "marker.raw", *marker, "--output", "poses.csv", folder=folder)
    return folder


@pytest.fixture(scope="session")
def camera(folder):
    return evmarker.load_calibration(folder / "marker.yml")


@pytest.fixture(scope="session")
def events(folder):
    return joined(evmarker.read(folder / "marker.raw"))


@pytest.fixture(scope="session")
def poses(camera, events):
    """Of the events in one call."""
    return evmarker.Tracker(camera, "DICT_4X4_50", 0.1).push(events)
