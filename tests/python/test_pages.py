"""The page, the script and the type hints say what the module does."""

import ast
import inspect
import os
import re
import subprocess
import sys

import pytest

import evmarker
from conftest import PAGES


def test_samples_of_the_page_run(folder):
    samples = re.findall(r"^```python\n(.*?)^```", (PAGES / "README.md").read_text(), re.M | re.S)
    assert samples
    for name, link in {"recording.raw": "marker.raw", "camera.yml": "marker.yml"}.items():
        os.symlink(link, folder / name)
    subprocess.run([sys.executable, "-c", "\n".join(samples)], cwd=folder, check=True)


def plot(folder, *arguments):
    script = [sys.executable, PAGES / "plot_poses.py", "marker.raw", "--camera", "marker.yml", *arguments]
    return subprocess.run(script, cwd=folder, capture_output=True, text=True)


def test_the_script_plots(folder):
    pytest.importorskip("matplotlib")
    done = plot(folder, "--marker-length", "0.1", "--output", "plot.png")
    assert done.returncode == 0, done.stderr
    assert (folder / "plot.png").read_bytes().startswith(b"\x89PNG")

    for output in ("marker.raw", "marker.yml"):
        before = (folder / output).read_bytes()
        done = plot(folder, "--marker-length", "0.1", "--output", output)
        assert (done.returncode, done.stdout) == (1, "")
        assert done.stderr == f"plot_poses: {output} is also read: give --output another name\n"
        assert (folder / output).read_bytes() == before
    done = plot(folder, "--output", "other.png")
    assert (done.returncode, done.stderr) == (
        1,
        "plot_poses: the following arguments are required: --marker-length (see --help)\n",
    )
    done = plot(folder, "--marker-length", "-1", "--output", "other.png")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "must be a positive number of metres, not -1" in done.stderr
    assert not (folder / "other.png").exists()
    done = plot(folder, "--marker-length", "0.1", "--dictionary", "DICT_7X7_50", "--output", "other.png")
    assert (done.returncode, done.stderr) == (2, "plot_poses: no marker was found\n")


def parameters_in_docstring(function):
    """Names of the parameters of each overload, from pybind11's signatures."""
    signatures = re.findall(r"^(?:\d\. )?\w+\((.*)\) -> ", function.__doc__, re.M)
    return [re.findall(r"(?:^|, )(\w+)(?=:|,|$)", re.sub(r"\[[^][]*(\[.*?\])?[^][]*\]", "", s)) for s in signatures]


def test_type_hints_name_what_there_is():
    stub = ast.parse((PAGES / "package" / "__init__.pyi").read_text())
    hinted = {node.name: node for node in stub.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    variables = {node.target.id for node in stub.body if isinstance(node, ast.AnnAssign)}
    assert sorted(set(hinted) | variables - {"__version__"}) == sorted(evmarker.__all__)

    def names(node):
        return [argument.arg for argument in node.args.args + node.args.kwonlyargs]

    for name, node in hinted.items():
        there = getattr(evmarker, name)
        if isinstance(node, ast.FunctionDef):
            assert [names(node)] == parameters_in_docstring(there), name
            continue
        members = {member for member in vars(there) if not member.startswith("_")}
        assert members == {f.name for f in node.body if not f.name.startswith("_")}, name
        for member in {f.name for f in node.body}:
            overloads = [f for f in node.body if f.name == member]
            if inspect.isdatadescriptor(getattr(there, member)) or member in ("__iter__", "__next__"):
                continue
            assert [names(f) for f in overloads] == parameters_in_docstring(getattr(there, member)), (name, member)
