"""Trajectory files under full disks, kills, damage, changed contents and interrupts: no silent loss, no raw error."""

import errno
import gzip
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from contextlib import suppress

import h5py
import numpy as np
import pytest

import mbvi
from mbvi.results.files import checked_file, verification, writing
from mbvi.results.files.pages import damaged_pages, find_record
from support.comparisons import same_states
from support.faults import damaged_files as faults
from support.paths import DATA, ROBOTS
from support.programs import LIMIT, interruptible, started
from support.programs import run as run_program
from support.scenes import hopper_and_brick

OLD = DATA / "old_files"


def crouch(t, q, v):
    """A control of the hopper's two joints."""
    return np.r_[np.zeros(6), -20.0 * (q[7:] - [0.1, 0.4]) - v[6:]]


@pytest.fixture(scope="module")
def run():
    return mbvi.simulate(hopper_and_brick(), mbvi.Paoli(), step=1e-3, duration=0.4)


@pytest.fixture(scope="module")
def located():
    return mbvi.simulate(hopper_and_brick(), mbvi.EventDriven(tolerance=1e-6), duration=0.3)


@pytest.fixture
def saved(run, tmp_path):
    run.save(tmp_path / "run.h5")
    return tmp_path / "run.h5"


# disks


LIMITED = """
import json, os, resource, sys
import mbvi
from support.scenes import hopper_and_brick
path, found = sys.argv[1], []
run = mbvi.simulate(hopper_and_brick(), mbvi.Paoli(), step=1e-3, duration=1.5)
for limit in json.loads(sys.argv[2]):
    for mode in ("save", "paoli", "located"):
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        try:
            if mode == "save":
                run.save(path)
            elif mode == "paoli":
                mbvi.simulate(hopper_and_brick(), mbvi.Paoli(), step=1e-3, duration=1.5, out=path)
            else:
                mbvi.simulate(hopper_and_brick(), mbvi.EventDriven(1e-6), duration=0.2, out=path)
            error = None
        except mbvi.TrajectoryFileError as caught:
            error = caught
        try:
            back = mbvi.load(path)
        except mbvi.TrajectoryFileError:
            back = None
        if error is None:
            assert back.complete
        else:
            assert "limit of file sizes" in str(error) and path in str(error), error
            assert error.run.complete == (mode == "save") and len(error.run.t) > 0
            assert back is None or not back.complete
        if back is not None and error is not None:
            n = len(back.t)
            assert (back.q == error.run.q[:n]).all() and (back.v == error.run.v[:n]).all()
            assert f"keeps the first {n} states" in str(error)
        found.append((mode, limit, error is None, 0 if back is None else len(back.t)))
print(json.dumps(found))
"""


def test_a_file_size_limit_at_any_place_is_an_error_and_what_was_written_loads(tmp_path):
    """The limit stands for a full disk: both are errors of the same calls."""
    limits = [1, 1000, *np.geomspace(8e3, 1.2e6, 10).astype(int).tolist()]
    done = run_program([sys.executable, "-c", LIMITED, tmp_path / "run.h5", json.dumps(limits)])
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    for mode in ("save", "paoli", "located"):
        outcomes = [(whole, states) for m, _, whole, states in found if m == mode]
        assert not outcomes[0][0] and outcomes[-1][0]
        # some limits leave a part
        assert any(states and not whole for whole, states in outcomes)


def observed(monkeypatch, act):
    """Call act(number, half) in the middle and at the end of each write to the disk."""
    number, write = [0], checked_file._write

    def writes(file, data, offset):
        number[0] += 1
        half = len(data) // 2
        write(file, data[:half], offset)
        act(number[0], True)
        write(file, data[half:], offset + half)
        act(number[0], False)

    monkeypatch.setattr(checked_file, "_write", writes)
    return number


@pytest.mark.parametrize("kind", ["run", "located"])
@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.slow)])
def test_a_kill_between_any_two_writes_leaves_all_that_was_committed(every, kind, request, tmp_path, monkeypatch):
    """Each state of the disk between two writes is one that a kill can leave."""
    whole, left = request.getfixturevalue(kind), tmp_path / "left.h5"
    seen, known = [], set()

    def look(number, half):
        if (2 * number + half) % every:
            return
        shutil.copyfile(tmp_path / "run.h5", left)
        raw = hash(left.read_bytes())
        if raw in known:
            return
        known.add(raw)
        try:
            back = mbvi.load(left)
        except mbvi.TrajectoryFileError:
            assert not seen, "what was there is there no more"
            return
        same_states(back, whole)
        seen.append((len(back.t), back.complete))

    monkeypatch.setattr("mbvi.results.files.writing._PIECE", 1 << 15)
    observed(monkeypatch, look)
    whole.save(tmp_path / "run.h5")
    assert seen == sorted(seen) and seen[-1][0] == len(whole.t) and len({n for n, _ in seen}) > 1
    assert mbvi.load(tmp_path / "run.h5").complete


@pytest.mark.parametrize("seed", range(12))
def test_a_checked_file_holds_its_last_commit_or_the_next_at_every_moment(seed, tmp_path, monkeypatch):
    """Any writes and lengths, not only those of HDF5; the beginning is a superblock that names the length."""
    rng, path = np.random.default_rng(seed), tmp_path / "file"
    model, committed, allowed = bytearray(), b"", []

    def look(number, half):
        raw = os.open(path, os.O_RDONLY)
        try:
            record, _ = find_record(raw)
            if record is None:
                # only the first commit is not whole from its beginning on
                assert not committed
                return
            assert damaged_pages(raw, record) == 0
            assert verification._Overlaid(raw, record).read() in allowed
        finally:
            os.close(raw)

    observed(monkeypatch, look)
    file = checked_file.CheckedFile(str(path))
    for _ in range(12):
        for _ in range(int(rng.integers(1, 6))):
            place, data = (
                int(rng.integers(36, 36 + len(model) + 9000)),
                rng.bytes(int(rng.choice([1, 50, 9000, 40000]))),
            )
            model.extend(bytes(max(place + len(data) - len(model), 0)))
            model[place : place + len(data)] = data
            file.seek(place)
            file.write(data)
        if rng.random() < 0.4:
            del model[int(rng.integers(36, len(model))) :]
            file.truncate(len(model))
        model[:36] = b"\x89HDF\r\n\x1a\n\x02".ljust(28, b"\0") + len(model).to_bytes(8, "little")
        file.seek(0)
        file.write(bytes(model[:36]))
        file.seek(0)
        assert file.read() == model
        allowed = [committed, bytes(model)]
        file.commit()
        committed = bytes(model)
        assert path.read_bytes()[: len(model)] == model
    file.close()


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_a_write_that_fails_anywhere_is_an_error_and_keeps_what_was_committed(code, run, tmp_path, monkeypatch):
    path, counted = tmp_path / "run.h5", observed(monkeypatch, lambda number, half: None)
    run.save(path)
    monkeypatch.undo()
    total, kept = counted[0], []
    for fails in range(1, total + 1, 1 + total // 25):

        def full(number, half, fails=fails):
            if number >= fails and half:
                raise OSError(code, os.strerror(code))

        observed(monkeypatch, full)
        with pytest.raises(mbvi.TrajectoryFileError) as caught:
            run.save(path)
        monkeypatch.undo()
        assert caught.value.run is run and isinstance(caught.value.__cause__, OSError)
        try:
            back = mbvi.load(path)
        except mbvi.TrajectoryFileError:
            assert not kept
            continue
        same_states(back, run)
        kept.append(len(back.t))
    assert kept == sorted(kept) and kept[-1] == len(run.t)


def test_a_disk_that_stores_something_else_is_noticed_before_a_file_is_complete(run, tmp_path, monkeypatch, rng):
    path, write = tmp_path / "run.h5", checked_file._write
    for wrong in range(1, 40, 3):
        number = [0]

        def lies(file, data, offset, number=number, wrong=wrong):
            number[0] += 1
            data = bytearray(data)
            if number[0] >= wrong and len(data) > 1000:
                data[int(rng.integers(len(data)))] ^= 1
            write(file, memoryview(bytes(data)), offset)

        monkeypatch.setattr(checked_file, "_write", lies)
        with pytest.raises(mbvi.TrajectoryFileError):
            run.save(path)
        monkeypatch.undo()
        with pytest.raises(mbvi.TrajectoryFileError):
            mbvi.load(path)


def test_numbers_that_differ_from_the_run_are_noticed_whoever_changed_them(run, tmp_path, monkeypatch):
    append = writing.append_rows

    def changed(group, columns, values, sums):
        if len(values.get("v", ())):
            v = values["v"].copy()
            v[-1] = np.nextafter(v[-1], 9.0)
            values = {**values, "v": v}
        append(group, columns, values, sums)

    monkeypatch.setattr(writing, "append_rows", changed)
    with pytest.raises(mbvi.TrajectoryFileError, match="v differs when read back"):
        run.save(tmp_path / "run.h5")
    assert not mbvi.load(tmp_path / "run.h5").complete


@pytest.mark.parametrize("at", [3, 20, 55])
def test_an_interrupt_within_a_write_waits_for_its_end(at, run, tmp_path, monkeypatch):
    during = []

    def interrupt(number, half):
        if number == at and half:
            os.kill(os.getpid(), signal.SIGINT)
        during.append(number)

    observed(monkeypatch, interrupt)
    with pytest.raises(KeyboardInterrupt), interruptible():
        run.save(tmp_path / "run.h5")
    assert during[-1] > at or len(during) % 2 == 0
    monkeypatch.undo()
    try:
        back = mbvi.load(tmp_path / "run.h5")
    except mbvi.TrajectoryFileError as error:
        assert "no states" in str(error)
    else:
        same_states(back, run)


def test_a_failing_disk_does_not_hide_another_error(tmp_path, monkeypatch):
    def control(t, q, v):
        if t > 0.02:
            monkeypatch.setattr(checked_file, "_write", full)
            raise ZeroDivisionError("of the control")
        return np.zeros(len(v))

    def full(*_):
        raise OSError(errno.ENOSPC, "full")

    with pytest.raises(ZeroDivisionError) as caught:
        mbvi.simulate(hopper_and_brick(control), mbvi.Paoli(), step=1e-3, duration=1.0, out=tmp_path / "run.h5")
    assert "the disk is full" in caught.value.__notes__[0]
    assert 0.0 < caught.value.run.t[-1] <= 0.03 and not caught.value.run.complete


@pytest.mark.slow
def test_python_may_end_while_a_thread_writes(tmp_path):
    program = (
        "import sys, threading, time\nimport mbvi\n"
        "from support.scenes import hopper_and_brick\np = hopper_and_brick()\n"
        "go = lambda: mbvi.simulate(p, mbvi.Paoli(), step=1e-3, duration=1e4, every=1000, out=sys.argv[1])\n"
        "threading.Thread(target=go, daemon=True).start()\ntime.sleep(3.0)\n"
    )
    done = run_program([sys.executable, "-c", program, tmp_path / "run.h5"])
    assert done.returncode == 0, done.stderr
    assert not mbvi.load(tmp_path / "run.h5").complete


# damage


@pytest.mark.parametrize("kind", ["run", "located"])
@pytest.mark.parametrize("seeds", [range(80), pytest.param(range(80, 1000), marks=pytest.mark.slow)])
def test_flipped_bytes_never_load_as_another_run(kind, seeds, request, tmp_path):
    path = tmp_path / "run.h5"
    request.getfixturevalue(kind).save(path)
    whole, expected = path.read_bytes(), faults.contents(mbvi.load(path))
    # HDF5 reads such a file in another process first, which takes a hundred times as long
    found, cuts = [], seeds[::40] if len(seeds) > 100 else seeds[::10]
    for seed in seeds:
        rng = np.random.default_rng(seed)
        faults.restore(path, whole)
        faults.flip_bytes(path, rng, int(rng.choice([1, 1, 1, 2, 5, 50])))
        if seed in cuts:
            faults.cut(path, rng)
        found.append(faults.loads_or_says(path, expected))
    assert "same" not in found


@pytest.mark.parametrize("seeds", [range(12), pytest.param(range(12, 100), marks=pytest.mark.slow(seconds=11))])
def test_damage_is_found_where_the_checksums_of_pages_are_gone_too(seeds, saved):
    """What HDF5's checksums, and the digest, find alone; HDF5 reads such files in another process first."""
    faults.without_checksums(saved)
    whole, expected = saved.read_bytes(), faults.contents(mbvi.load(saved))
    for seed in seeds:
        rng = np.random.default_rng(seed)
        faults.restore(saved, whole)
        # object headers and indices are at the beginning
        faults.flip_bytes(saved, rng, int(rng.choice([1, 1, 4])), None if seed % 2 else 25_000)
        faults.loads_or_says(saved, expected)


@pytest.mark.parametrize("fault", ["while True: pass", "import os; os.kill(os.getpid(), 11)", "x = bytes(10**11)"])
def test_a_file_that_hangs_or_crashes_hdf5_is_an_error(fault, saved, monkeypatch):
    """The fault stands in the other process where HDF5 would be."""
    faulty = verification._READ_ALL.replace('read("/", file)', fault)
    assert faulty != verification._READ_ALL
    monkeypatch.setattr(verification, "_READ_ALL", faulty)
    monkeypatch.setattr(verification, "_TIME", 2)
    faults.without_checksums(saved)
    with pytest.raises(mbvi.TrajectoryFileError):
        mbvi.load(saved)


def test_columns_have_checksums_of_their_own(located, tmp_path):
    located.save(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5") as file:
        found = []
        file.visititems(lambda name, thing: found.append(thing) if isinstance(thing, h5py.Dataset) else None)
        assert len(found) > 15
        assert all(d.fletcher32 for d in found if d.ndim)
        # the rest is text of one length within the file's pages, not in HDF5's heap
        assert [d.name for d in found if not d.ndim] == ["/problem/scene"]


@pytest.mark.parametrize("sealed", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize("part", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 6))])
def test_wrong_contents_are_errors(sealed, part, saved, tmp_path):
    """Sealed, the digest was made to fit: then other numbers may be those of another run, but no error is a raw one."""
    whole, expected = saved.read_bytes(), faults.contents(mbvi.load(saved))
    changes = list(faults.mutations(saved))
    assert len(changes) > 400
    for k in range(part, len(changes), 6 if sealed else 24):
        faults.restore(saved, whole)
        faults.mutate(saved, changes[k][1], np.random.default_rng(k), sealed=sealed)
        if not sealed:
            faults.loads_or_says(saved, expected)
            continue
        try:
            back = mbvi.load(saved)
        except mbvi.TrajectoryFileError:
            continue
        except mbvi.MbviWarning:
            # the scene was changed to one with functions
            continue
        assert back.q.shape == expected[0][1][0] and np.isfinite(back.q).all() and (np.diff(back.t) > 0).all()


REFUSED = {
    "q: _narrower": "q has shape", "q: _wider": "q has shape", "q: _missing": "no column q", "t: _reversed": "t",
    "t: _swapped": "ascend",
    "t: _single": "t holds float32", "q: _objects": "q", "q: one nan": "q holds numbers", "q: _shorter": "rows",
    "energy: _shorter": "energy has", "v: one inf": "v holds", "impacts/constraint: _objects": "nobody | nothing",
    "problem/q0: _shorter": "problem/q0", "/@step = -1": "step", "/@scheme = None": "scheme",
    "/@complete = 3.5": "complete", "scene gravity = [[1]]": "run.h5", "scene without robots": "robots",
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_each_wrong_content_is_named(name, saved):
    faults.mutate(saved, dict(faults.mutations(saved))[name], np.random.default_rng(1), sealed=True)
    with pytest.raises(mbvi.TrajectoryFileError, match=REFUSED[name]):
        mbvi.load(saved)


def _another_robot(data):
    data["robots"][0]["urdf"] = data["robots"][0]["urdf"].replace('mass value="', 'mass value="1')


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_another_robot, "energies"),
        (
            lambda data: data["robots"][0].update(urdf=(ROBOTS / "double_pendulum/double_pendulum.urdf").read_text()),
            "run.h5",
        ),
        (lambda data: data["bodies"][0].update(extra=1), "extra"),
        (lambda data: data["bodies"][0].update(velocity=[[1, 2], [3, 4], [5, 6]]), "run.h5"),
        (lambda data: data["bodies"][0].update(mass=-1.0), "run.h5"),
        (lambda data: data.update(extra=1), "extra cannot be read without loss"),
        (lambda data: data["order_of_q_and_v"].reverse(), "order"),
        (lambda data: data.update(kind="film"), "unknown kind"),
    ],
)
def test_another_scene_is_refused(change, said, saved):
    def apply(file, rng):
        data = json.loads(file["problem/scene"][()])
        change(data)
        del file["problem/scene"]
        file["problem"].create_dataset("scene", data=np.bytes_(json.dumps(data).encode()))
        return ""

    faults.mutate(saved, apply, np.random.default_rng(0), sealed=True)
    with pytest.raises(mbvi.TrajectoryFileError, match=said):
        mbvi.load(saved)


def test_an_unknown_option_of_a_scheme_is_refused(saved):
    def apply(file, rng):
        file.attrs["scheme_options"] = json.dumps({"project_positions": False, "colour": 1})
        return ""

    faults.mutate(saved, apply, np.random.default_rng(0), sealed=True)
    with pytest.raises(mbvi.TrajectoryFileError, match="colour"):
        mbvi.load(saved)


def test_a_number_changed_by_hdf5_is_noticed(saved):
    for name in ("q", "energy", "impacts/percussion"):
        copy = saved.with_name("copy.h5")
        shutil.copyfile(saved, copy)
        with h5py.File(copy, "r+") as file:
            file[name][0] += 1e-9
        with pytest.raises(mbvi.TrajectoryFileError, match="digest"):
            mbvi.load(copy)


def test_a_file_may_be_added_to_by_hdf5(saved):
    expected = faults.contents(mbvi.load(saved))
    with h5py.File(saved, "r+") as file:
        file["own/data"] = np.arange(3)
    assert faults.loads_or_says(saved, expected) == "same"


@pytest.mark.parametrize(("name", "states", "impacts"), [("paoli", 31, 8), ("event", 71, 30)])
def test_files_without_checksums_load(name, states, impacts, tmp_path):
    (tmp_path / "old.h5").write_bytes(gzip.decompress((OLD / f"{name}.h5.gz").read_bytes()))
    back = mbvi.load(tmp_path / "old.h5")
    assert (len(back.t), len(back.impacts), back.complete) == (states, impacts, True)
    assert back.problem.system.nq == back.q.shape[1]
    # the states of then are those of now
    again = mbvi.simulate(back.problem, back.record.scheme, step=back.step or None, duration=0.05)
    n = int(np.searchsorted(back.t, 0.05)) - 1
    np.testing.assert_allclose(back.at(float(back.t[n]))[0], again.at(float(back.t[n]))[0], atol=1e-9)
    back.save(tmp_path / "new.h5")
    assert faults.contents(mbvi.load(tmp_path / "new.h5")) == faults.contents(back)


# what a file cannot keep


def test_a_lost_control_is_named_and_needed(tmp_path):
    run = mbvi.simulate(hopper_and_brick(crouch), mbvi.Paoli(), step=1e-3, duration=0.3, out=tmp_path / "run.h5")
    with pytest.warns(mbvi.MbviWarning, match="control of robot 'hopper'"):
        lost = mbvi.load(tmp_path / "run.h5")
    assert "control of robot 'hopper'" in lost.notes[-1]
    for go in (
        lambda p: mbvi.simulate(p, duration=0.1),
        lambda p: mbvi.simulate(p, mbvi.EventDriven(1e-6), duration=0.1),
        lambda p: mbvi.steps(p, step=1e-3),
    ):
        with pytest.raises(mbvi.InputError, match=r"'hopper'.*mbvi.load\(path, control="):
            go(lost.problem)
    given = mbvi.load(tmp_path / "run.h5", control={"hopper": crouch})
    assert given.notes == run.notes
    again = mbvi.simulate(given.problem, mbvi.Paoli(), step=1e-3, duration=0.3)
    assert again.q.tobytes() == run.q.tobytes()
    assert given.diagnosis().energy_excess == run.diagnosis().energy_excess
    # what was lost stays lost in the file of a loaded run, and says so once
    lost.save(tmp_path / "second.h5")
    with pytest.warns(mbvi.MbviWarning, match="'hopper'"):
        second = mbvi.load(tmp_path / "second.h5")
    assert second.notes == lost.notes
    again = mbvi.load(tmp_path / "second.h5", control={"hopper": crouch}).problem
    assert mbvi.simulate(again, mbvi.Paoli(), step=1e-3, duration=0.3).q.tobytes() == run.q.tobytes()


def test_a_lost_control_keeps_the_joints_that_it_counts(tmp_path):
    """A joint whose limits leave no range is left out only where no control counts it."""
    urdf = (ROBOTS / "hopper/hopper.urdf").read_text().replace('lower="-2.4"', 'lower="0.4"', 1)
    limits = [part.split('"')[0] for part in urdf.split('lower="')[1:]]
    urdf = urdf.replace(f'lower="{limits[-1]}"', 'lower="0.4"')
    urdf = re.sub(r'(lower="0.4" upper=")[^"]*', r"\g<1>0.4", urdf)
    assert 'lower="0.4" upper="0.4"' in urdf
    (tmp_path / "hopper.urdf").write_text(urdf)
    scene = mbvi.Scene()
    scene.add_urdf(tmp_path / "hopper.urdf", joints={"knee": 0.4}, control=crouch, name="hopper")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.02, out=tmp_path / "run.h5")
    with pytest.warns(mbvi.MbviWarning, match="hopper"):
        assert mbvi.load(tmp_path / "run.h5").problem.system.nv == run.v.shape[1] == 8


@pytest.mark.parametrize("control", [{"hoper": crouch}, {"brick": crouch}, {"hopper": 3}])
def test_a_control_for_nobody_is_an_error(control, tmp_path):
    mbvi.simulate(hopper_and_brick(crouch), mbvi.Paoli(), step=1e-3, duration=0.01, out=tmp_path / "run.h5")
    with pytest.raises(mbvi.InputError, match="control"):
        mbvi.load(tmp_path / "run.h5", control=control)


def test_a_control_that_fails_when_given_back_is_no_fault_of_the_file(tmp_path):
    mbvi.simulate(hopper_and_brick(crouch), mbvi.Paoli(), step=1e-3, duration=0.01, out=tmp_path / "run.h5")
    with pytest.raises(mbvi.InputError, match="shape"):
        mbvi.load(tmp_path / "run.h5", control={"hopper": lambda t, q, v: np.zeros(3)})


def test_a_file_keeps_the_state_of_its_problem(run, tmp_path, rng):
    built, k = run.problem, 200
    q, v = run.q[k], run.v[k] + rng.normal(size=run.v.shape[1])
    for more in ({}, {"length": built.length}, {"length": built.length, "restitution": 0.25}):
        more = {"t0": 3.25, **more}
        problem = mbvi.Problem(built.system, built.constraints.constraints, q, v, scene=built.scene, **more)
        again = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05, out=tmp_path / "run.h5")
        back = mbvi.load(tmp_path / "run.h5").problem
        for name in ("q0", "v0", "restitution"):
            assert getattr(back, name).tobytes() == getattr(problem, name).tobytes()
        assert (back.t0, back.length, back.tolerance) == (problem.t0, problem.length, problem.tolerance)
        assert mbvi.simulate(back, mbvi.Paoli(), step=1e-3, duration=0.05).q.tobytes() == again.q.tobytes()


def test_any_axis_of_a_wall_that_turns_loads_as_it_was(tmp_path, rng):
    """Unit vectors are rounded: to make one of one that is read must not change it."""
    for axis in rng.normal(size=(30, 3)):
        motion = mbvi.motion.Rotation(axis, 1.0)
        assert mbvi.motion.Rotation(motion.axis, 1.0) == motion
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), motion=motion)
    scene.add_sphere(0.1, position=(0, 0, 1))
    mbvi.simulate(scene.build(), step=1e-2, duration=0.02).save(tmp_path / "run.h5")
    assert mbvi.load(tmp_path / "run.h5").q.shape == (3, 3)


def test_constraints_given_by_hand_are_named(run, tmp_path):
    built = run.problem
    problem = mbvi.Problem(built.system, built.constraints.constraints[:-1], built.q0, built.v0, scene=built.scene)
    mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05, out=tmp_path / "run.h5")
    with pytest.warns(mbvi.MbviWarning, match="constraints given by hand"):
        back = mbvi.load(tmp_path / "run.h5")
    with pytest.raises(mbvi.InputError, match="constraints given by hand"):
        mbvi.simulate(back.problem, duration=0.1)


def test_a_file_being_written_says_so(tmp_path):
    said = []

    def control(t, q, v):
        if 0.01 < t < 0.0125:
            for use in (mbvi.load, short.save):
                with pytest.raises(mbvi.TrajectoryFileError, match="locked by a run that is still going on") as caught:
                    use(tmp_path / "run.h5")
                said.append(str(caught.value))
        return np.zeros(len(v))

    short = mbvi.simulate(hopper_and_brick(), mbvi.Paoli(), step=1e-3, duration=0.01)
    mbvi.simulate(hopper_and_brick(control), mbvi.Paoli(), step=1e-3, duration=0.02, out=tmp_path / "run.h5")
    assert said and "run the simulation again" not in said[0]
    assert len(mbvi.load(tmp_path / "run.h5", control={"hopper": control}).t) == 21


# interrupts


INTERRUPTED = """
import os, signal, sys, threading
import mbvi
from mbvi.compiled import compile_all
from support.comparisons import same_states
from support.scenes import hopper_and_brick
compile_all()
for scheme, step in (mbvi.Paoli(), 1e-3), (mbvi.Centered(project_positions=True), 1e-3), (mbvi.EventDriven(1e-9), None):
    # imports what the scheme needs, which may take longer than the time until the interrupt
    mbvi.simulate(hopper_and_brick(), scheme, step=step, duration=1e-2)
    for out in (None, sys.argv[1]):
        threading.Timer(0.4, os.kill, (os.getpid(), signal.SIGINT)).start()
        try:
            mbvi.simulate(hopper_and_brick(), scheme, step=step, duration=200.0, out=out)
            raise SystemExit("not interrupted")
        except KeyboardInterrupt as stop:
            run = stop.run
        assert not run.complete and 1 < len(run.t) == len(run.q) == len(run.v) == len(run.energy()), run.t
        whole = mbvi.simulate(hopper_and_brick(), scheme, step=step, duration=min(float(run.t[-2]), 0.5))
        # where the end is not yet near, which error control looks ahead to
        n = int((whole.t < 0.5 * whole.t[-1]).sum())
        assert (whole.q[:n] == run.q[:n]).all()
        if out:
            back = mbvi.load(out)
            assert not back.complete
            same_states(back, run)
            assert len(back.t) == len(run.t)
        else:
            run.save(sys.argv[1])
            assert not mbvi.load(sys.argv[1]).complete
print("done")
"""


def test_an_interrupt_carries_the_run_so_far(tmp_path):
    done = run_program([sys.executable, "-c", INTERRUPTED, tmp_path / "run.h5"])
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr


def test_an_error_of_a_step_carries_the_run_so_far():
    def control(t, q, v):
        return np.zeros(len(v) - (t > 0.05))

    with pytest.raises(mbvi.InputError) as caught:
        mbvi.simulate(hopper_and_brick(control), mbvi.Paoli(), step=1e-3, duration=1.0)
    assert len(caught.value.run.t) == pytest.approx(51, abs=1) and not caught.value.run.complete


@pytest.mark.parametrize("out", [None, "run.h5"])
def test_the_command_line_says_where_an_interrupted_run_is(out, tmp_path):
    command = [sys.executable, "-c", "import sys; from mbvi.cli.main import main; main(sys.argv[1:])", "simulate"]
    command += [str(ROBOTS / "hopper/hopper.urdf"), "--duration", "1000", "--every", "10", "--step", "1e-3"]
    with started(command + (["--out", out] if out else []), cwd=tmp_path) as child:
        # the problem is printed before the run starts
        while child.stdout.readline().strip():
            pass
        with suppress(subprocess.TimeoutExpired):
            child.wait(3.0)
        child.send_signal(signal.SIGINT)
        said, error = child.communicate(timeout=LIMIT)
    path = tmp_path / (out or "interrupted.h5")
    assert (child.returncode, error) == (130, "mbvi: interrupted\n")
    assert f"{path.name} (interrupted at t = " in said
    back = mbvi.load(path)
    assert not back.complete and len(back.t) > 1
