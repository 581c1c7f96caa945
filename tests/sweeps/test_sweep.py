"""Studies in this process: points, rows, tables, refusals; workers are threads here, processes in test_kills.py."""

import json
import pickle
import sys
import threading
import time
import warnings

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.cli.main import main
from mbvi.compiled import Kernel, seconds_compiling
from mbvi.sweeps import batch
from mbvi.sweeps.batch import Done
from mbvi.sweeps.fingerprint import digest
from mbvi.sweeps.one_run import row_of
from mbvi.sweeps.points import points_of
from mbvi.sweeps.rows import read_rows, write_rows
from mbvi.sweeps.scheduling import BatchSizes
from mbvi.sweeps.status import status as text_of
from mbvi.sweeps.study import Study, StudyFolder
from support import sweep_functions as f
from support.programs import LIMIT
from support.programs import run as run_program

OPTIONS = {"scheme": mbvi.Paoli(), "step": 2e-3, "duration": 0.1}
GRID = {"height": [0.1, 0.2, 0.3], "e": [0.0, 0.5]}


@pytest.fixture
def sweep(sweeps_in_a_thread, tmp_path):
    def call(make=f.drop, parameters=GRID, out="study", **more):
        given = {"measure": f.bounces, "client": sweeps_in_a_thread, **OPTIONS, **more}
        return mbvi.sweep(make, parameters, out=tmp_path / out, **given)

    return call


def same(one: xr.Dataset, other: xr.Dataset) -> bool:
    drop = ["cpu", "host"]
    one, other = one.drop_vars(drop).drop_attrs(), other.drop_vars(drop).drop_attrs()
    return one.identical(other) and all(
        one[n].dtype == other[n].dtype
        and (one[n].dtype == object or one[n].values.tobytes() == other[n].values.tobytes())
        for n in one.variables
    )


def test_a_grid_becomes_dimensions_and_each_entry_is_its_run(sweep):
    table = sweep()
    assert table["status"].dims == ("height", "e") and (table["status"] == "ok").all()
    for k, (height, e) in enumerate((h, e) for h in GRID["height"] for e in GRID["e"]):
        run = mbvi.simulate(f.drop(height, e).build(), progress=False, **OPTIONS)
        one = table.sel(height=height, e=e)
        assert one["run"] == k
        assert one["count"] == len(run.impacts) and one["high"].dtype == bool and one["word"] == "Paoli"
        np.testing.assert_array_equal(one["last"], run.q[-1])
        times = [impact.time for impact in run.impacts]
        np.testing.assert_array_equal(one["times"][: len(times)], times)
        assert np.isnan(one["times"][len(times) :]).all()
    assert table["cpu"].attrs["units"] == "s" and (table["cpu"] > 0).all()
    assert "OpenBLAS" in str(table["host"][0, 0].values)


def test_lists_tables_and_arrays_give_the_same_runs(sweep):
    points = [{"height": 0.1 * k, "e": 0.1 * k} for k in range(1, 5)]
    tables = [
        sweep(parameters=points, out="list"),
        sweep(parameters=pd.DataFrame(points), out="frame"),
        sweep(parameters=np.array([[p["height"], p["e"]] for p in points]), out="array"),
    ]
    assert tables[0]["status"].dims == ("run",)
    np.testing.assert_array_equal(tables[0]["e"], [p["e"] for p in points])
    assert same(tables[0], tables[1]) and same(tables[0], tables[2])


def test_random_numbers_depend_on_the_seed_and_the_number_of_the_run_alone(sweep):
    first = sweep(f.drop_by_chance, measure=f.energy)
    again = sweep(f.drop_by_chance, {"height": [0.1], "e": [0.0, 0.5]}, out="part", measure=f.energy)
    other = sweep(f.drop_by_chance, out="other", measure=f.energy, seed=1)
    np.testing.assert_array_equal(first["energy"][0], again["energy"][0])
    assert not np.intersect1d(first["energy"], other["energy"]).size
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(5,)))
    run = mbvi.simulate(f.drop_by_chance(0.3, 0.5, rng).build(), progress=False, **OPTIONS)
    np.testing.assert_array_equal(first["v"][2, 1], run.v[-1])


def test_a_finished_study_is_read_and_the_missing_runs_of_another_are_made(sweep, tmp_path):
    table = sweep()
    files = sorted((tmp_path / "study/rows").glob("*.parquet"))
    before = {path: path.stat().st_mtime_ns for path in files}
    assert same(sweep(), table)
    assert {path: path.stat().st_mtime_ns for path in files} == before
    files[0].unlink()
    assert same(sweep(), table)


def test_rows_that_are_there_twice_count_once(sweep, tmp_path):
    table = sweep()
    rows = read_rows(tmp_path / "study/rows").to_pylist()
    write_rows(tmp_path / "study/rows/again.parquet", rows[2:4])
    assert same(sweep(), table)


def flipped(path, rng):
    data = bytearray(path.read_bytes())
    data[rng.integers(len(data))] ^= 1 << rng.integers(8)
    path.write_bytes(data)


def cut(path, rng):
    path.write_bytes(path.read_bytes()[: rng.integers(path.stat().st_size)])


def rewritten(change):
    def damage(path, rng):
        table = pq.read_table(path)
        pq.write_table(change(table, table.column_names[rng.integers(table.num_columns)]), path)

    return damage


DAMAGES = {
    "a flipped bit": flipped,
    "cut off": cut,
    "another file": lambda path, rng: path.write_text("no rows"),
    "a dropped column": rewritten(lambda table, name: table.drop([name])),
    "a renamed column": rewritten(lambda table, name: table.rename_columns({name: "other"})),
    "another number": rewritten(lambda table, _: table.set_column(0, "run", pa.array([10**6] * table.num_rows))),
    "the same, written by others": rewritten(lambda table, _: table),
}


@pytest.mark.parametrize("kind", DAMAGES)
def test_damaged_rows_are_refused_by_name_and_made_again_where_they_are_removed(kind, sweep, tmp_path):
    table = sweep()
    files = sorted((tmp_path / "study/rows").glob("*.parquet"))
    for seed in range(30 if kind in ("a flipped bit", "cut off") else 3):
        rng = np.random.default_rng(seed)
        path = files[rng.integers(len(files))]
        before = path.read_bytes()
        DAMAGES[kind](path, rng)
        for act in (sweep, lambda: text_of(StudyFolder(tmp_path / "study"))):
            with pytest.raises(mbvi.TrajectoryFileError, match=f"{path.name} is damaged, or was changed"):
                act()
        path.write_bytes(before)
    assert same(sweep(), table)
    path.unlink()
    assert same(sweep(), table)


def test_rows_of_another_study_and_a_damaged_study_are_refused(sweep, tmp_path):
    sweep()
    sweep(parameters={"height": [0.1] * 9, "e": [0.5]}, out="larger")
    sweep(parameters={"height": [0.1], "e": [0.5]}, out="smaller")
    last = max((tmp_path / "larger/rows").glob("*.parquet"))
    (tmp_path / "smaller/rows" / last.name).write_bytes(last.read_bytes())
    with pytest.raises(mbvi.TrajectoryFileError, match="rows of another study, of run"):
        sweep(parameters={"height": [0.1], "e": [0.5]}, out="smaller")
    path = tmp_path / "study/study.json"
    about = json.loads(path.read_text())
    for name, value in [("runs", "6"), ("versions", None), ("format", "mbvi study 1")]:
        path.write_text(json.dumps({**about, name: value}))
        with pytest.raises(mbvi.InputError, match=r"holds no study that mbvi.sweep wrote: .*" + name):
            sweep()


CHANGES = {
    "make is another one": {"make": f.drop_by_chance},
    "measure is another one": {"measure": f.height},
    "parameters is another one there; runs is 6 there and 4 here": {
        "parameters": {"height": [0.1, 0.2], "e": [0.0, 0.5]}
    },
    "seed is 0 there and 3 here": {"seed": 3},
    "budget is None there and 5.0 here": {"budget": 5.0},
    "keep is none there and all here": {"keep": "all"},
    "duration is 0.1 there and 0.2 here": {"duration": 0.2},
    r"scheme is Paoli\(\) there and Centered\(\) here": {"scheme": mbvi.Centered()},
    "every is None there and 2 here": {"every": 2},
}


@pytest.mark.parametrize("message", CHANGES)
def test_another_study_in_the_same_folder_is_refused_with_the_difference_named(message, sweep):
    sweep()
    with pytest.raises(mbvi.InputError, match=message):
        sweep(**CHANGES[message])


def test_other_versions_are_refused(sweep, tmp_path):
    sweep()
    path = tmp_path / "study/study.json"
    about = json.loads(path.read_text())
    about["versions"]["numpy"] = "1.0"
    path.write_text(json.dumps(about))
    with pytest.raises(mbvi.InputError, match=r"versions numpy is 1.0 there and"):
        sweep()


def test_a_study_that_is_running_is_refused(sweep, tmp_path):
    sweep()
    with StudyFolder(tmp_path / "study").alone(), pytest.raises(mbvi.InputError, match="another process is running"):
        sweep()


class Waiting(Kernel):
    """A kernel that waits for another process to compile it."""

    def compiled(self):
        time.sleep(1.0)
        return lambda: 0.0


def wait_for_kernel():
    type("wait", (Waiting,), {})(lambda: 0.0, "f8()")()


def test_cpu_time_is_measured_by_cpu_clocks(tmp_path):
    def make(spins):
        wait_for_kernel()
        begin = time.thread_time()
        try:
            while spins:
                pass
        finally:
            spent.append(time.thread_time() - begin)
        return f.drop(0.1)

    spent = []
    study = Study(make, f.height, budget=0.1, options=OPTIONS)
    rows = [row_of(study, k, {"spins": spins}, tmp_path) for k, spins in enumerate([False, True])]
    assert [row["status"] for row in rows] == ["ok", "over budget"]
    assert all(row["cpu"] > 0.0 for row in rows)
    # the second of waiting is no CPU time
    assert 0.05 < spent[1] < 0.6


def test_what_one_thread_compiles_is_no_time_of_another():
    before = seconds_compiling()
    thread = threading.Thread(target=wait_for_kernel)
    thread.start()
    thread.join()
    there = seconds_compiling(thread.ident)
    assert there.wall > 0.9 and 0.0 <= there.cpu < 0.5
    assert seconds_compiling() == before


def test_what_goes_wrong_in_a_run_is_its_row(sweep, tmp_path):
    kinds = ["fine", "raises", "diverges", "diverges without energy", "no problem", "endless", "fine again"]
    table = sweep(f.troubled, {"kind": kinds}, measure=f.height, budget=0.5, keep="failed")
    found = dict(zip(kinds, table["status"].values, strict=True))
    assert found == {
        "fine": "ok", "raises": "failed", "diverges": "diverged",
        "diverges without energy": "diverged", "no problem": "failed", "endless": "over budget",
        "fine again": "ok",
    }  # fmt: skip
    said = dict(zip(kinds, table["message"].values, strict=True))
    assert said["raises"] == "ValueError: no scene today"
    assert "must return a Scene or a Problem; it returned int" in said["no problem"]
    assert said["endless"] == "more than 0.5 s of CPU time" and said["fine"] == ""
    assert np.isnan(table["height"].values).tolist() == [kind[:4] != "fine" for kind in kinds]
    assert "; the run is not kept: force" in said["diverges without energy"]
    # the run so far
    assert [path.name for path in (tmp_path / "study/runs").iterdir()] == ["00000002.h5"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        assert not mbvi.load(tmp_path / "study/runs/00000002.h5").complete
    assert mbvi.plot_sweep(table, ["height"]).axes


@pytest.mark.parametrize(
    ("measure", "message"),
    [(f.wrong_measure, "names that are no parameters"), (f.nothing, "must return a mapping")],
)
def test_wrong_results_of_measure_are_rows_that_say_so(measure, message, sweep):
    table = sweep(measure=measure)
    assert (table["status"] == "failed").all()
    assert message in str(table["message"].values[0, 0])


def test_a_quantity_that_is_a_number_here_and_a_text_there_is_refused(sweep):
    with pytest.raises(mbvi.InputError, match="same kind of value in every run"):
        sweep(measure=lambda run: {"x": "low" if run.q[0, 2] < 0.35 else 1.0})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parameters": {}}, "1 to 1000000000 points"),
        ({"parameters": {"height": []}}, "1 to 1000000000 points"),
        ({"parameters": {"height": 0.1}}, r"parameters\['height'\] must be a sequence"),
        ({"parameters": {"length": [0.1]}}, "make cannot be called with length"),
        ({"parameters": [{"height": 1.0}, {"e": 1.0}]}, "every point must have the same names"),
        ({"parameters": np.zeros((2, 3))}, "has 3 columns; make takes 2"),
        ({"parameters": np.zeros(2)}, r"must be numbers of shape \(n, d\)"),
        ({"parameters": {"run": [1]}, "make": lambda run: f.drop(0.1)}, "names of arguments of make"),
        ({"make": mbvi.Scene}, "make must be a function"),
        ({"measure": 5}, "measure must be a function"),
        ({"keep": "some"}, "keep must be one of"),
        ({"client": 5}, "client must be a distributed.Client"),
        ({"progress": True}, "progress is no option of a sweep"),
        ({"lenght": 1.0}, "options of simulate: got an unexpected keyword argument 'lenght'"),
        ({"make": lambda height, e, _=(x for x in ()): None}, "cannot be sent to other processes"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_refused_before_the_first_run(change, message, sweep, tmp_path):
    with pytest.raises(mbvi.InputError, match=message):
        sweep(**change)
    assert not (tmp_path / "study/study.json").exists()


def test_a_folder_that_cannot_be_written_or_has_other_files_is_refused(sweep, tmp_path):
    (tmp_path / "file").write_text("")
    for out in ("file/study", "nowhere/study"):
        with pytest.raises(mbvi.TrajectoryFileError, match="cannot be written"):
            sweep(out=out)
    with pytest.raises(mbvi.InputError, match="is not empty and holds no study, but 'file'"):
        sweep(out=".")


def test_a_run_is_replayed_whether_it_was_kept_or_not(sweep, tmp_path):
    table = sweep(f.drop_by_chance, measure=f.energy)
    again = mbvi.replay(tmp_path / "study", run=3, html=tmp_path / "page.html")
    assert again.energy()[-1] == table["energy"].values.ravel()[3]
    assert (tmp_path / "page.html").stat().st_size > 500_000
    sweep(f.drop_by_chance, measure=f.energy, out="kept", keep="all")
    assert len(list((tmp_path / "kept/runs").glob("*.h5"))) == 6
    kept = mbvi.replay(tmp_path / "kept", run=3, html=tmp_path / "page.html")
    assert kept.q.tobytes() == again.q.tobytes()
    with pytest.raises(mbvi.InputError, match="runs 0 to 5"):
        mbvi.replay(tmp_path / "study", run=6)
    with pytest.raises(mbvi.InputError, match="run must be the number of a run"):
        mbvi.replay(tmp_path / "study")
    with pytest.raises(mbvi.InputError, match=r"a run is played by run\.replay\(\)"):
        mbvi.replay(kept)
    with pytest.raises(mbvi.InputError, match="holds no study"):
        mbvi.replay(tmp_path, run=0)
    (tmp_path / "study/functions.pkl").write_bytes(b"no pickle")
    with pytest.raises(mbvi.InputError, match="cannot be loaded"):
        mbvi.replay(tmp_path / "study", run=3, html=tmp_path / "page.html")


def test_the_status_of_a_study(sweep, tmp_path, capsys):
    sweep(f.troubled, {"kind": ["fine", "raises"]}, measure=f.height)
    with pytest.raises(SystemExit) as leave:
        main(["sweep", "--status", str(tmp_path / "study")])
    said = capsys.readouterr().out
    assert leave.value.code == 0
    assert "runs         2 of 2, complete\nok           1\nfailed       1\n" in said
    assert "message      1 times: ValueError: no scene today" in said
    with pytest.raises(SystemExit):
        main(["sweep", "--status", str(tmp_path)])
    assert "holds no study" in capsys.readouterr().err


def test_one_process_at_a_time_makes_its_first_run_and_those_that_waited_go_on_together(monkeypatch, tmp_path):
    monkeypatch.setattr(batch.tempfile, "gettempdir", lambda: str(tmp_path))
    order, begun, go_on = [], threading.Event(), threading.Event()

    def first():
        with batch.first_run_alone():
            begun.set()
            go_on.wait(LIMIT)
            order.append("first")

    def other():
        with batch.first_run_alone():
            order.append("other")

    threads = []
    for run in (first, other, other):
        # each thread stands for a process of its own
        monkeypatch.setattr(batch, "_first_run", True)
        threads.append(threading.Thread(target=run))
        threads[-1].start()
        assert begun.wait(LIMIT)
        time.sleep(0.05)
    assert order == []
    go_on.set()
    for thread in threads:
        thread.join(LIMIT)
    assert order == ["first", "other", "other"]
    # the second run of a process does not wait
    with batch.first_run_alone(), batch.first_run_alone():
        pass


def test_packages_are_imported_when_they_are_used_and_named_when_they_are_missing(sweep, monkeypatch):
    names = "{'dask', 'distributed', 'pandas', 'xarray', 'pyarrow', 'matplotlib'}"
    program = f"import sys, mbvi; print(sorted({names} & set(sys.modules)))"
    done = run_program([sys.executable, "-c", program])
    assert done.stdout == "[]\n", done.stderr
    monkeypatch.setattr(mbvi.sweeps.cluster, "_PACKAGES", ("distributed", "no_such_package"))
    with pytest.raises(mbvi.InputError, match=r"sweeps need no_such_package: pip install 'mbvi\[sweep\]'"):
        sweep()


def test_batches_that_take_too_long_give_runs_back(sweep, monkeypatch):
    table = sweep(f.drop_by_chance, measure=f.energy)
    given = []
    monkeypatch.setattr(batch, "_LONGEST", -1.0)
    monkeypatch.setattr(BatchSizes, "next", lambda self, left, workers: 4)
    monkeypatch.setattr(BatchSizes, "add", lambda self, done: given.append(done.left))
    assert same(sweep(f.drop_by_chance, measure=f.energy, out="again"), table)
    # of batches of four and of two runs one is made each time
    assert sorted(given) == [0, 0, 1, 1, 2, 3]


def test_a_run_in_which_processes_ended_is_given_up(tmp_path):
    folder, points = StudyFolder(tmp_path / "study"), points_of(GRID, f.drop)
    folder.open(Study(f.drop, f.energy, options=OPTIONS), points)
    numbered = [(k, points[k]) for k in range(3)]
    # two processes ended in run 1, and a third one in run 2
    (folder.rows / "000000000.running").write_bytes(b"".join(k.to_bytes(8, "little") for k in (1, 1, 2)))
    done = batch.run_batch(str(folder.path), numbered, 1)
    rows = read_rows(folder.rows)
    assert (done.runs, done.failed) == (3, 1)
    assert rows["status"].to_pylist() == ["ok", "killed", "ok"]
    assert not list(folder.rows.glob("*.running"))


FILES = {
    "must define measure, options": "make = parameters = 1",
    "cannot be imported: NameError: name 'no' is not defined": "no",
    "options must be those of simulate; seed stands": "make = parameters = measure = seed = 1; options = {'seed': 1}",
    "make must be a function": "make = parameters = measure = 1; options = {}",
}


@pytest.mark.parametrize("message", FILES)
def test_a_file_that_defines_no_study_is_refused(message, tmp_path, monkeypatch, capsys):
    # each file has a name of its own, because modules are imported once
    path = tmp_path / f"study_{sorted(FILES).index(message)}.py"
    path.write_text(FILES[message])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for arguments in ([str(path)], ["no_file.py"], ["--resume", str(tmp_path)]):
        with pytest.raises(SystemExit) as leave:
            main(["sweep", *arguments])
        said = capsys.readouterr().err
        assert leave.value.code == 2 and said.startswith("mbvi: ")
        if arguments == [str(path)]:
            assert message in said


@given(st.lists(st.integers(1, 4), min_size=1, max_size=3), st.data())
def test_the_points_of_a_grid_are_the_product_in_order(sizes, data):
    import itertools

    grid = {name: list(range(n)) for name, n in zip("abc", sizes, strict=False)}
    points = points_of(grid, lambda **point: None)
    expected = [dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values())]
    assert [points[k] for k in range(len(points))] == expected
    assert pickle.loads(pickle.dumps(points)).digest() == points.digest()
    with pytest.raises(IndexError):
        points[len(points)]


@given(st.lists(st.floats(1e-3, 100.0), min_size=1, max_size=30), st.integers(1, 50))
def test_batches_take_seconds_and_leave_work_for_every_worker(times, workers):
    sizes, left = BatchSizes(), 100_000
    assert sizes.next(left, workers) == 1
    for seconds in times:
        n = sizes.next(left, workers)
        sizes.add(Done(n, 0, n * seconds, n))
    n, shortest = sizes.next(left, workers), min(times)
    assert 1 <= n <= max(1, 7.5 / shortest)
    assert sizes.next(2, workers) <= max(2, 0.5 / shortest)


BALL = 0.3


def with_default(x, size=BALL):
    """Say something."""
    return x + size + helper(x)


def helper(x):
    return x * BALL


def adding(k):
    return lambda x: x + k


def test_a_digest_is_that_of_the_code_and_what_it_names(monkeypatch):
    before = digest(with_default)
    assert digest(with_default) == before
    with_default.__doc__ = "Say something else."
    assert digest(with_default) == before
    with monkeypatch.context() as patched:
        patched.setitem(globals(), "BALL", 0.4)
        assert digest(with_default) != before
    with monkeypatch.context() as patched:
        patched.setitem(globals(), "helper", lambda x: x)
        assert digest(with_default) != before
    assert digest(with_default) == before
    closures = [digest(adding(k)) for k in (1, 2, 1)]
    assert closures[0] == closures[2] != closures[1]
    values = [1, 1.0, "1", True, (1,), [1, 2], {"a": 1}, {"b": 1}, np.ones(1), np.ones(2), None, mbvi.Paoli(), min, max]
    assert len({digest(value) for value in values}) == len(values)
    loop = []
    loop.append(loop)
    with pytest.raises(mbvi.InputError, match="cannot be described"):
        digest(loop)


def test_pictures_have_a_panel_for_each_quantity_and_mark_failures(sweep):
    table = sweep()
    figure = mbvi.plot_sweep(table)
    # a map and its bar of colours for each of count and high
    assert [axes.get_title() for axes in figure.axes if axes.get_title()] == ["count", "high"]
    assert len(mbvi.plot_sweep(table, ["count"]).axes) == 2
    named = table.copy()
    named["high"].attrs.update(units="m", long_name="highest point")
    axes = mbvi.plot_sweep(named, ["high"]).axes[0]
    assert axes.get_title() == "highest point [m]"
    # one parameter: a line each
    assert len(mbvi.plot_sweep(table.isel(e=0)).axes) == 2
    for wrong, message in [(5, "must be the Dataset"), (table.drop_vars("status"), "must be the Dataset")]:
        with pytest.raises(mbvi.InputError, match=message):
            mbvi.plot_sweep(wrong)
    with pytest.raises(mbvi.InputError, match="no quantity 'last'"):
        mbvi.plot_sweep(table, ["last"])
