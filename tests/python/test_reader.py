import faulthandler
import os
import threading
import tracemalloc

import numpy as np
import pytest

import evmarker
from conftest import joined, run


def test_events_are_those_that_convert_writes(folder, events):
    run("convert", "marker.raw", "marker.csv", folder=folder)
    x, y, p, t = np.loadtxt(folder / "marker.csv", delimiter=",", dtype=int, comments="%", unpack=True)
    for name, column in {"x": x, "y": y, "p": p, "t": t}.items():
        np.testing.assert_array_equal(events[name], column)


def test_text_is_read_as_the_options_say(folder):
    np.savetxt(folder / "plain.txt", [[1, 2, 1, 5], [2, 1, 0, 6], [1, 1, 1, 7]], fmt="%d")
    text = evmarker.read(folder / "plain.txt", sensor_size=(640, 480), columns="y,x,p,t", time_unit="ms")
    assert joined(text).tolist() == [(2, 1, 1, 5000), (1, 2, 0, 6000), (1, 1, 1, 7000)]
    with pytest.raises(ValueError, match="plain.txt: .*sensor"):
        evmarker.read(folder / "plain.txt", columns="y,x,p,t", time_unit="ms")


def test_a_reader_says_what_it_reads(folder, events):
    reader = evmarker.read(str(folder / "marker.raw"))
    assert (reader.format, reader.sensor_size) == ("Prophesee RAW, EVT3", (640, 480))
    first = next(reader)
    assert first.dtype == evmarker.EVENT_DTYPE
    assert reader.statistics["events"] == len(first)
    rest = list(reader)
    np.testing.assert_array_equal(joined([first, *rest]), events)  # each array is its own
    with pytest.raises(StopIteration):
        next(reader)


def test_memory_does_not_grow_with_the_recording(folder, events):
    tracemalloc.start()
    count = sum(len(array) for array in evmarker.read(folder / "marker.raw"))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count == len(events)
    assert peak < events.nbytes / 10


@pytest.mark.parametrize(
    "sentence, path, options",
    [
        ("none.raw: cannot open: No such file or directory", "none.raw", {}),
        ("empty.raw: the file is empty", "empty.raw", {}),
        ("recorded with 640 x 480 px, but sensor_size says 320 x 240 px", "marker.raw", {"sensor_size": (320, 240)}),
        ('time_unit is "weeks", not s, ms, us or ns', "marker.raw", {"time_unit": "weeks"}),
    ],
)
def test_what_cannot_be_read_is_a_value_error(folder, sentence, path, options):
    (folder / "empty.raw").touch()
    with pytest.raises(ValueError) as raised:
        evmarker.read(folder / path, **options)
    assert str(raised.value).endswith(sentence)


def test_other_threads_run_while_a_pipe_is_silent(tmp_path, folder, events):
    """Else the thread that fills the pipe would wait forever, and this one, too."""
    faulthandler.dump_traceback_later(120, exit=True)
    pipe = tmp_path / "pipe.raw"
    os.mkfifo(pipe)
    content = (folder / "marker.raw").read_bytes()

    def fill():
        with open(pipe, "wb") as file:
            file.write(content)

    thread = threading.Thread(target=fill)
    thread.start()
    np.testing.assert_array_equal(joined(evmarker.read(pipe)), events)
    thread.join()
    faulthandler.cancel_dump_traceback_later()
