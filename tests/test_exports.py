"""Files of runs say how they were made, and a run is made again from them."""

import json

import numpy as np
import pytest

from labkit import ModelError, repeated, simulate, sweep
from labkit.exports import how

from .systems import ball, stick_slip

try:
    import pandas
    import pyarrow
except ImportError:  # the workbook does without them
    pandas = pyarrow = None

KINDS = ["csv", "npz", *(["parquet"] if pyarrow else [])]
OPTIONS = [
    {},
    {"method": "RK4", "step": 0.01, "points": 31},
    {"rtol": 1e-6, "atol": {"y": 1e-7, "v": 1e-6}, "start": {"y": 3.0}, "e": 0.5},
    {"points": np.linspace(0.25, 1.0, 7), "t0": 0.25, "locate": False},
]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("options", OPTIONS)
def test_a_run_is_made_again_from_its_file(tmp_path, kind, options):
    run = simulate(ball(), 2.0, **options)
    path = getattr(run, f"to_{kind}")(tmp_path / f"run.{kind}")
    again = repeated(ball(), path)
    assert again.p == run.p and again.stopped == run.stopped
    np.testing.assert_array_equal(again.t, run.t)
    np.testing.assert_array_equal(again.values, run.values)
    assert how(again) == how(run)


def test_the_first_line_of_a_csv_file_is_a_comment(tmp_path):
    run = simulate(ball(), 1.0)
    first, head, *_ = run.to_csv(tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()
    assert json.loads(first[1:]) == how(run) and head.startswith("t [s],j,mode,y [m]")
    table = np.genfromtxt(tmp_path / "run.csv", delimiter=",", skip_header=2)  # as students do
    np.testing.assert_array_equal(table[:, 3], run["y"])


def test_files_that_do_not_say_it(tmp_path):
    for damaged in (b"", b"PK\x03\x04 cut off"):
        (tmp_path / "run.npz").write_bytes(damaged)
        with pytest.raises(ModelError, match="run.npz' cannot be read"):
            repeated(ball(), tmp_path / "run.npz")
    path = simulate(ball(), 1.0).to_csv(tmp_path / "run.csv")
    with pytest.raises(ModelError, match="holds a run of 'bouncing ball', and the model is"):
        repeated(stick_slip(), path)
    path.write_text("t,y\n0,1\n")
    with pytest.raises(ModelError, match="does not say how"):
        repeated(ball(), path)
    np.savez(tmp_path / "other.npz", t=[1.0])
    for name in ("other.npz", "nowhere.csv"):
        with pytest.raises(ModelError, match="cannot be read"):
            repeated(ball(), tmp_path / name)


def test_a_sweep_as_columns_and_a_frame(tmp_path):
    m = sweep(ball(), 1.0, lambda run: run.final["y"], e=[0.5, 0.7], y=[1.0, -5.0], progress=False)
    columns = m.columns()
    assert list(columns)[:2] == ["e", "y"] and columns["e"] == [0.5, 0.5, 0.7, 0.7]
    assert columns["reason"][0] == "" and columns["reason"][1]
    if pandas is None:
        with pytest.raises(ModelError, match="pip install pandas"):
            m.to_frame()
    else:
        assert m.to_frame().shape == (4, 4)


def test_frames_and_parquet_where_their_packages_are(tmp_path, monkeypatch):
    run = simulate(ball(), 1.0)
    if pandas is not None:
        frame = run.to_frame()
        assert frame.attrs["how"] == how(run) and list(frame.columns) == list(run.columns())
    if pyarrow is None:
        with pytest.raises(ModelError, match="pip install pyarrow"):
            run.to_parquet(tmp_path / "run.parquet")
    else:
        table = pyarrow.parquet.read_table(run.to_parquet(tmp_path / "run.parquet"))
        assert table.column("y").to_pylist() == run["y"].tolist()
