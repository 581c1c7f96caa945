"""Tables and files of other programs: what is read from them is the run, to the bit."""

import csv
import json
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

import mbvi
from mbvi.results.replay.motion import motion
from mbvi.results.tables import table
from support.paths import ROBOTS

TABLES = ("states", "impacts", "contacts")
QUOTED = 'br"i, ck'


@pytest.fixture(scope="module")
def run():
    """A robot with joint limits, which have no contact point, and a body whose name needs quotes; with friction."""
    scene = mbvi.Scene(restitution=0.3, friction=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.55), joints={"knee": 0.4}, velocity={"knee": -9.0})
    scene.add_box((0.2, 0.1, 0.1), position=(0.6, 0, 0.2), angular_velocity=(0, 1, 0), name=QUOTED)
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.4, record="contacts")


@pytest.fixture(scope="module")
def quiet():
    """A run without impacts, contacts and friction."""
    scene = mbvi.Scene()
    scene.add_sphere(0.1, name="ball")
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1)


def test_the_run_has_what_is_hard_to_write(run):
    columns = table(run, "impacts")
    assert np.isnan(columns["point/x"].values).any() and not np.isnan(columns["point/x"].values).all()
    assert any(QUOTED in name for name in columns["constraint"].values)
    assert set(columns["regime"].values) >= {"slip"}


@pytest.mark.parametrize("name", TABLES)
def test_csv_holds_the_same_bits(run, tmp_path, name):
    run.export(tmp_path / "run.csv", table=name)
    with (tmp_path / "run.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    columns = table(run, name)
    assert [h.partition(" [")[0] for h in head] == list(columns)
    for k, (key, column) in enumerate(columns.items()):
        texts = [row[k] for row in rows]
        if isinstance(column.values, list):
            assert texts == column.values
        else:
            read = np.array([float(text) for text in texts]).astype(column.values.dtype)
            assert read.tobytes() == column.values.tobytes(), key
        unit = column.unit
        assert head[k] == (key if unit in ("", "1") else f"{key} [{unit}]")


@pytest.mark.parametrize("name", TABLES)
def test_parquet_holds_the_same_bits_units_and_texts(run, tmp_path, name):
    run.export(tmp_path / "run.parquet", table=name)
    read = pq.read_table(tmp_path / "run.parquet")
    columns = table(run, name)
    assert read.column_names == list(columns)
    for key, column in columns.items():
        field = read.schema.field(key)
        assert field.metadata == {b"unit": column.unit.encode(), b"description": column.description.encode()}
        if isinstance(column.values, list):
            assert read[key].to_pylist() == column.values
        else:
            found = read[key].to_numpy()
            assert found.dtype == column.values.dtype and found.tobytes() == column.values.tobytes(), key
    assert read.schema.metadata[b"scheme"] == b"Paoli" and float(read.schema.metadata[b"step"]) == run.step


def test_the_columns_of_states_are_q_and_v(run):
    columns = table(run, "states")
    for letter, states in (("q", run.q), ("v", run.v)):
        values = [one.values for key, one in columns.items() if key.startswith(f"{letter}/")]
        np.testing.assert_array_equal(np.stack(values, axis=1), states)
    assert columns["q/hopper/knee"].unit == "rad" and columns["v/hopper/knee"].unit == "rad/s"
    assert [columns[f"q/{QUOTED}/{k}"].unit for k in ("x", "qw")] == ["m", "1"]
    kinetic, potential = run.energies()
    np.testing.assert_array_equal(columns["energy/kinetic"].values, kinetic)
    np.testing.assert_array_equal(columns["energy/potential"].values, potential)


def test_names_of_coordinates_move_what_they_name():
    """A push along each velocity changes the coordinates of the same robot or body, and in a plane its own axes."""
    scene = mbvi.Scene(plane="xz")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 1))
    scene.add_box((1, 1, 1), position=(5, 0, 1), name="box")
    scene.add_sphere(0.1, position=(9, 0, 1), name="ball")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.02)
    of_q = [key for key in table(run, "states") if key.startswith("q/")]
    of_v = [key for key in table(run, "states") if key.startswith("v/")]
    assert (len(of_q), len(of_v)) == (run.q.shape[1], run.v.shape[1])
    system = run.problem.system
    for k, name in enumerate(of_v):
        moved = np.flatnonzero(system.integrate(run.q[0], 1e-3 * np.eye(len(of_v))[k]) != run.q[0])
        owner, _, part = name.removeprefix("v/").rpartition("/")
        named = [of_q[i].removeprefix("q/") for i in moved]
        if owner == "hopper":
            assert named == [f"hopper/{part}"]
        elif part in ("vx", "vz"):
            assert named == [f"{owner}/{part[1]}"]
        else:
            assert part == "w" and {one.rpartition("/")[0] for one in named} == {owner}


def test_pandas_and_xarray_have_the_same_numbers(run):
    frame, data = run.to_pandas(), run.to_xarray()
    assert frame.index.name == "t" and (frame.index == run.t).all()
    np.testing.assert_array_equal(frame.filter(regex="^q/").to_numpy(), run.q)
    np.testing.assert_array_equal(frame.filter(regex="^v/").to_numpy(), run.v)
    assert frame.attrs["units"]["q/hopper/hip"] == "rad"
    np.testing.assert_array_equal(data["q"].values, run.q)
    np.testing.assert_array_equal(data["q"].sel(coordinate="hopper/knee"), frame["q/hopper/knee"])
    np.testing.assert_array_equal(data["energy_kinetic"], frame["energy/kinetic"])
    assert data["energy_kinetic"].attrs["units"] == "J" and data["t"].attrs["units"] == "s"
    assert data["coordinate_unit"].sel(coordinate="hopper/knee") == "rad"
    for name, dimension in (("impacts", "impact"), ("contacts", "contact")):
        rows = run.to_pandas(name)
        assert len(rows) == data.sizes[dimension] > 0
        np.testing.assert_array_equal(rows["percussion"], data[f"{dimension}_percussion"])
        np.testing.assert_array_equal(rows["point/z"], data[f"{dimension}_point"].sel(axis="z"))
        assert list(rows["constraint"]) == data[f"{dimension}_constraint"].values.tolist()
    percussions = np.concatenate([impact.percussion for impact in run.impacts])
    np.testing.assert_array_equal(run.to_pandas("impacts")["percussion"], percussions)
    # what is returned may be changed
    frame.iloc[0, 0] = data["q"][0, 0] = 7.0
    assert run.q[0, 0] != 7.0


def test_a_run_without_impacts_has_empty_tables(quiet, tmp_path):
    for name in ("run.csv", "run.parquet"):
        quiet.export(tmp_path / name, table="impacts")
    assert len(pd.read_csv(tmp_path / "run.csv")) == pq.read_table(tmp_path / "run.parquet").num_rows == 0
    assert len(quiet.to_pandas("impacts")) == quiet.to_xarray().sizes["impact"] == 0
    quiet.export(tmp_path / "run.mcap")
    assert len(messages(tmp_path / "run.mcap", "/state")) == len(quiet.t)


def test_given_functions_have_numbers_for_names(tmp_path):
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(2), force=lambda t, q, v: np.array([0.0, -9.81]), dim=2)
    problem = mbvi.Problem(system, [mbvi.GapFunction(lambda q: q[1], lambda q: np.array([0.0, 1.0]))], [0, 1], [1, 0])
    run = mbvi.simulate(problem, mbvi.EventDriven(), duration=1.0)
    assert list(run.to_pandas().columns[:4]) == ["q/0", "q/1", "v/0", "v/1"]
    run.export(tmp_path / "run.mcap")
    states = messages(tmp_path / "run.mcap", "/state")
    assert np.array([list(state["q"].values()) for _, state in states]).tobytes() == run.q.tobytes()


def messages(path, topic):
    """Return time [ns] and content of each message of a topic."""
    with path.open("rb") as file:
        return [(m.log_time, json.loads(m.data)) for _, _, m in make_reader(file).iter_messages(topics=[topic])]


def test_mcap_holds_states_impacts_shapes_and_poses(run, tmp_path):
    path = tmp_path / "run.mcap"
    run.export(path)
    states = messages(path, "/state")
    for letter, values in (("q", run.q), ("v", run.v)):
        assert np.array([list(state[letter].values()) for _, state in states]).tobytes() == values.tobytes()
    assert [state["t"] for _, state in states] == run.t.tolist()
    assert np.abs(np.array([time for time, _ in states]) * 1e-9 - run.t).max() < 1e-9
    impacts = [content for _, content in messages(path, "/impacts")]
    assert [content["time"] for content in impacts] == [impact.time for impact in run.impacts]
    for content, impact in zip(impacts, run.impacts, strict=True):
        assert [row["constraint"] for row in content["contacts"]] == list(impact.constraints)
        assert [row["percussion"] for row in content["contacts"]] == impact.percussion.tolist()
        heights = [np.nan if row["point/z"] is None else row["point/z"] for row in content["contacts"]]
        np.testing.assert_array_equal(heights, impact.point[:, 2])
    ((_, scene),) = messages(path, "/scene")
    names = {entity["id"]: entity["frame_id"] for entity in scene["entities"]}
    assert names[QUOTED] == QUOTED and "hopper/knee" in names.values()
    moves, frames = motion(run), messages(path, "/tf")
    assert len(frames) == len(moves.times)
    places, turns = moves.position[:, moves.driven :], moves.quaternion[:, moves.driven :]
    for (_, frame), place, turn in zip(frames, places, turns, strict=True):
        for one, p, x in zip(frame["transforms"], place, turn, strict=True):
            assert list(one["translation"].values()) == p.tolist() and list(one["rotation"].values()) == x.tolist()
    with path.open("rb") as file:
        reader = make_reader(file)
        schemas = {schema.name for schema in reader.get_summary().schemas.values()}
        units = next(m.metadata for m in reader.iter_metadata() if m.name == "units")
    assert schemas == {"mbvi.State", "mbvi.Impact", "foxglove.FrameTransforms", "foxglove.SceneUpdate"}
    assert units["q/hopper/knee"] == "rad"


@pytest.mark.parametrize(
    ("name", "chosen", "says"),
    [
        ("run.xlsx", None, r"\.csv, \.parquet, \.mcap"),
        ("run", "states", "names no kind of file"),
        ("run.csv", "velocities", "table must be"),
        ("run.mcap", "states", "give no table"),
        ("run.parquet", "contacts", "did not record contacts"),
    ],
)
def test_what_cannot_be_exported_is_refused(quiet, tmp_path, name, chosen, says):
    with pytest.raises(mbvi.InputError, match=says):
        quiet.export(tmp_path / name, chosen)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["run.csv", "run.parquet", "run.mcap"])
def test_a_folder_that_is_missing_is_named(quiet, tmp_path, name):
    with pytest.raises(mbvi.TrajectoryFileError, match=r"missing.*cannot be written"):
        quiet.export(tmp_path / "missing" / name)


@pytest.mark.parametrize(
    ("package", "call", "extra"),
    [
        ("pandas", lambda run, path: run.to_pandas(), "tables"),
        ("xarray", lambda run, path: run.to_xarray(), "tables"),
        ("pyarrow", lambda run, path: run.export(path / "run.parquet"), "tables"),
        ("mcap.writer", lambda run, path: run.export(path / "run.mcap"), "mcap"),
    ],
)
def test_a_missing_package_is_named_with_its_extra(quiet, tmp_path, monkeypatch, package, call, extra):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(mbvi.InputError, match=rf"pip install 'mbvi\[{extra}\]'"):
        call(quiet, tmp_path)
    # csv needs no package
    quiet.export(tmp_path / "run.csv")


def test_a_run_from_a_file_without_its_problem_still_has_tables(quiet, tmp_path):
    bare = replace(quiet, problem=None)
    assert list(bare.to_pandas().columns) == [
        *(f"q/{k}" for k in range(3)),
        *(f"v/{k}" for k in range(3)),
        "penetration",
        "limit_violation",
        "residual",
    ]
    bare.export(tmp_path / "run.mcap")
    assert len(messages(tmp_path / "run.mcap", "/state")) == len(quiet.t)
