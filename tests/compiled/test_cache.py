"""Processes of their own: when numba is imported, what the first use says, and when the cache is out of date."""

import importlib.util
import os
import select
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path

import numpy as np
import pytest

import mbvi
from mbvi.compiled import KERNELS, all_kernels, kernel
from mbvi.compiled.interrupts import interrupts_later
from support.programs import LIMIT, interruptible, run, started, wait_until

LANDING = """
import sys
import mbvi
assert "numba" not in sys.modules
scene = mbvi.Scene(restitution=0.5)
scene.add_halfspace((0, 0, 1))
scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.11))
problem = scene.build()
"""
RUN = """
run = mbvi.simulate(problem, step=1e-3, duration=0.1, progress=False)
assert run.impacts
print(repr(run.v[-1].tolist()))
"""
# needs few kernels: nothing touches
FLIGHT = """
import mbvi
scene = mbvi.Scene()
scene.add_halfspace((0, 0, 1))
scene.add_sphere(0.1, position=(0, 0, 0.5), velocity=(0.3, 0, 1))
run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.1, progress=False)
print(repr(run.v[-1].tolist()))
"""
NAME = "f\"{item.__module__.rpartition('.')[2]}.{item.__name__}\""
LOADED = f"""
from mbvi.compiled import KERNELS
print(*({NAME} for item in KERNELS if item._compiled is not None))
"""


def process(code, package=None, **environment):
    """What a new process that runs some code with a copy of the package prints, to both its ends."""
    variables = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | environment
    if package is not None:
        variables["PYTHONPATH"] = str(package.parent)
        code = f"import mbvi\nassert mbvi.__path__ == [{str(package)!r}]\n{code}"
    # without -P the working directory's package would come first
    command = [sys.executable, "-P", "-c", code]
    done = run(command, env=variables)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_importing_mbvi_imports_no_numba():
    process("import sys, mbvi\nassert 'numba' not in sys.modules")


@pytest.fixture(scope="module")
def landing(tmp_path_factory):
    """The folder that a box that falls on a floor fills with kernels, and what that process prints to both its ends."""
    folder = tmp_path_factory.mktemp("kernels")
    return folder, *process(LANDING + RUN, NUMBA_CACHE_DIR=str(folder))


def entries(folder, kind="nbc"):
    """The files of what Python calls; those of functions that kernels call bear other names."""
    return [file for file in folder.rglob(f"*.{kind}") if ".function." not in file.name]


@pytest.mark.slow
def test_a_scene_compiles_only_the_kernels_that_it_needs(landing):
    """A box that falls on a floor needs less than a quarter of the kernels."""
    assert 3 < len(entries(landing[0])) < len(all_kernels()) / 4


def test_a_kernel_that_is_in_the_cache_needs_no_others_to_be_loaded(tmp_path):
    """Machine code holds that of the kernels it calls."""
    code = """
import numpy as np
from mbvi.compiled import KERNELS
from mbvi.geometry.narrow.normal_search import normalise
a = np.array([3.0, 0.0, 4.0])
assert normalise(a) == 5.0
print(sum(item._code is not None for item in KERNELS))
"""
    assert process(code, NUMBA_CACHE_DIR=str(tmp_path))[0] == "2\n"
    # of the other one only what kernels take over
    assert (len(entries(tmp_path)), len([*tmp_path.rglob("*.function.*nbc")])) == (1, 2)
    assert process(code, NUMBA_CACHE_DIR=str(tmp_path))[0] == "1\n"


def test_a_stamp_goes_by_code_constants_and_callees_and_not_by_lines():
    known = len(KERNELS)

    def stamp(source):
        namespace = {"kernel": kernel, "np": np}
        exec(compile(source, "kernels", "exec"), namespace)
        del KERNELS[known:]
        return namespace["f"].stamp()

    called = "@kernel('f8(f8)')\ndef g(x):\n    return x\n"
    source = f"_HALF = 0.5\n{called}@kernel('f8(f8)')\ndef f(x):\n    return g(x) * _HALF\n"
    first = stamp(source)
    assert stamp("\n\n# moved down\n" + source) == first
    changes = ("0.5", "0.25"), ("return x", "return -x"), ("g(x) *", "g(x) +"), ("'f8(f8)')\ndef f", "'f4(f4)')\ndef f")
    assert len({first, *(stamp(source.replace(*change)) for change in changes)}) == 5


def copy_of_the_package(folder):
    """The package's own files, without what was compiled from them."""
    source = Path(mbvi.__file__).parent
    shutil.copytree(source, folder / "mbvi", ignore=shutil.ignore_patterns("__pycache__", "robots"))
    return folder / "mbvi"


@pytest.mark.slow
def test_the_first_run_says_that_it_compiles_and_the_second_reads_what_it_compiled(landing):
    folder, first, said = landing
    assert said.startswith("compiling")
    assert list(folder.rglob("*.nbc"))
    again, silent = process(LANDING + RUN, NUMBA_CACHE_DIR=str(folder))
    assert silent == ""
    assert again == first


@pytest.mark.slow
def test_where_nothing_can_be_cached_every_process_compiles_and_runs(tmp_path):
    """No place is left: a file stands where each folder of compiled code would be."""
    package = copy_of_the_package(tmp_path)
    for folder in {file.parent for file in package.rglob("*.py")}:
        (folder / "__pycache__").touch()
    (tmp_path / "file").touch()
    nowhere = {name: str(tmp_path / "file" / "cache") for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME")}
    expected, _ = process(FLIGHT)
    for _ in range(2):
        found, said = process(FLIGHT, package, **nowhere)
        assert said.startswith("compiling")
        assert found == expected
    assert not [*tmp_path.rglob("*.nbc"), *tmp_path.rglob("*.nbi")]


@pytest.mark.slow
def test_without_a_folder_of_the_user_kernels_are_kept_in_one_of_temporary_files(tmp_path):
    """But not in one that others can write to: the machine code in it is run."""
    package, temporary = copy_of_the_package(tmp_path), tmp_path / "temporary"
    (package / "compiled/__pycache__").touch()
    (tmp_path / "file").touch()
    temporary.mkdir()
    nowhere = {name: str(tmp_path / "file" / "cache") for name in ("XDG_CACHE_HOME", "HOME")}
    folder, said = temporary / f"mbvi-{os.getuid()}", []
    for mode in (0o700, 0o700, 0o770):
        if folder.exists():
            folder.chmod(mode)
        said.append(process(FLIGHT, package, TMPDIR=str(temporary), **nowhere)[1])
        assert folder.stat().st_mode & 0o777 == mode and entries(folder)
    assert [text.startswith("compiling") for text in said] == [True, False, True] and said[1] == ""


def test_a_kernel_is_compiled_anew_when_one_that_it_calls_elsewhere_has_changed(tmp_path):
    """`multipliers` calls `dot` of another file, of which a new version doubles the first coordinate."""
    package, cache_ = copy_of_the_package(tmp_path), str(tmp_path / "cache")
    code = """
import numpy as np
from mbvi.geometry.narrow.kinks import multipliers
found = np.zeros(1)
multipliers(np.array([1.0, 0.0, 0.0]), np.array([[1.0, 1.0, 0.0]]), 1, found)
print(found[0])
"""
    before, _ = process(code, package, NUMBA_CACHE_DIR=cache_)
    file = package / "geometry/vectors.py"
    text = file.read_text()
    changed = text.replace("return a[0] * b[0] + ", "return 2.0 * a[0] * b[0] + ")
    assert changed != text
    file.write_text(changed)
    after, _ = process(code, package, NUMBA_CACHE_DIR=cache_)
    assert (float(before), float(after)) == (1 / 2, 2 / 3)


NORMALISE = """
import numpy as np
import mbvi.compiled.kernels as kernels
kernels._announce = lambda name: print("compiling", name)
from mbvi.geometry.narrow.normal_search import normalise
print(normalise(np.array([3.0, 0.0, 4.0])))
"""


def test_a_second_copy_of_mbvi_compiles_nothing_again(tmp_path):
    first, second = (copy_of_the_package(tmp_path / name) for name in ("first", "second"))
    cache = str(tmp_path / "cache")
    assert "compiling normalise" in process(NORMALISE, first, NUMBA_CACHE_DIR=cache)[0]
    assert process(NORMALISE, second, NUMBA_CACHE_DIR=cache) == ("5.0\n", "")


@pytest.mark.slow(seconds=10)
def test_kernels_of_one_source_keep_their_own_machine_code(tmp_path):
    """Each is compiled in a process of its own, and both are loaded into another one, in either order."""
    (tmp_path / "one_source.py").write_text(
        """
from mbvi.compiled import calling_others, kernel

@kernel("f8(f8)")
def up(x):
    return x + 1.0

@kernel("f8(f8)")
def down(x):
    return x - 1.0

@kernel("f8(f8)")
def first(x):
    return up(x)

second = calling_others(first, "second", up=down)
"""
    )
    expected = {"first": "1.0", "second": "-1.0"}
    folders = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for names in (["first"], ["second"], ["first", "second"], ["second", "first"]):
        code = "import one_source\n" + "\n".join(f"print(one_source.{name}(0.0))" for name in names)
        assert process(code, **folders)[0].split() == [expected[name] for name in names]


@pytest.mark.slow
def test_versions_of_a_kernel_do_not_overwrite_each_other(tmp_path):
    package, cache = copy_of_the_package(tmp_path), str(tmp_path / "cache")
    file = package / "geometry/vectors.py"
    text = file.read_text()
    assert "return a[0] * b[0] + " in text
    versions = text, text.replace("return a[0] * b[0] + ", "return 2.0 * a[0] * b[0] + ")
    compiled = []
    for version in (*versions, *versions):
        file.write_text(version)
        compiled.append("compiling" in process(NORMALISE, package, NUMBA_CACHE_DIR=cache)[0])
    assert compiled == [True, True, False, False]


def test_of_many_versions_the_last_ones_are_kept(small_cache, monkeypatch):
    monkeypatch.setattr(mbvi.compiled.cache, "_MOST_FILES", 8)
    # numba looks for the module of what it reads
    kept = []
    for version in range(4):
        kept.append(small_kernel(small_cache, f"stamp {version}"))
        assert len([*small_cache.rglob("*.nb?")]) == min(4 * (version + 1), 8)
    assert not small_kernel(small_cache, "stamp 3")[1]
    assert small_kernel(small_cache, "stamp 0")[1]


def test_processes_that_start_together_compile_each_kernel_once(tmp_path):
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lambda _: process(NORMALISE, NUMBA_CACHE_DIR=str(tmp_path)), range(3)))
    lines = [line for out, _ in found for line in out.splitlines()]
    assert lines.count("5.0") == 3
    names = [line for line in lines if line.startswith("compiling")]
    # a kernel is announced for other kernels and for Python
    assert "compiling normalise" in names
    assert max(names.count(name) for name in names) <= 2
    assert all(said in ("", "another process compiles kernels: waiting for it ...\n") for _, said in found)


HOLD = """
import sys
from pathlib import Path
from mbvi.compiled.one_process import one_process
folder, name = Path(sys.argv[1]), sys.argv[2]
with one_process(folder, name), one_process(folder, f"a callee of {name}"):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_process_that_is_killed_keeps_nobody_out(tmp_path):
    command, pipe = [sys.executable, "-c", HOLD, str(tmp_path), "a"], subprocess.PIPE
    with (
        started(command, stdin=pipe, stderr=None) as first,
        started(command, stdin=pipe) as second,
    ):
        held = select.select([first.stdout, second.stdout], [], [], LIMIT)[0]
        assert len(held) == 1
        holder, other = (first, second) if held[0] is first.stdout else (second, first)
        assert not select.select([other.stdout], [], [], 0.3)[0]
        holder.kill()
        assert other.stdout.readline() == "held\n"
        # another kernel is compiled meanwhile
        with started([*command[:-1], "b"], stdin=pipe) as third:
            assert select.select([third.stdout], [], [], LIMIT)[0]
            third.kill()


THREE = """
from mbvi.compiled import kernel

@kernel("f8(f8)")
def first(x):
    return x + 1.0

@kernel("f8(f8)")
def second(x):
    return 2.0 * x

@kernel("f8(f8)")
def both(x):
    return first(x) + second(x)
"""
SLOWLY = """
import sys
import mbvi.compiled.kernels as kernels
called, held = sys.argv[1:]
def announce(name):
    print(name, flush=True)
    if name == held:
        sys.stdin.read()
kernels._announce = announce
import three
print(getattr(three, called)(0.0), flush=True)
"""


@pytest.mark.parametrize(("held", "left"), [("first", "second"), ("second", "first")])
def test_what_another_process_compiles_is_waited_for_last(tmp_path, held, left):
    """And compiled where that process is killed. One of both is asked for before the other one."""
    (tmp_path / "three.py").write_text(THREE)
    folders = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONHASHSEED": "0"}
    command, options = [sys.executable, "-c", SLOWLY], {"stdin": subprocess.PIPE, "env": os.environ | folders}
    with started([*command, held, held], **options) as holder:
        assert holder.stdout.readline() == f"{held}\n"
        with started([*command, "both", "none"], **options) as other:
            assert select.select([other.stdout], [], [], LIMIT)[0]
            assert other.stdout.readline() == f"{left}\n"
            assert not select.select([other.stdout], [], [], 0.3)[0]
            holder.kill()
            assert other.stdout.read().split() == [held, "both", "both", "1.0"]


KERNEL = """
def total(values):
    found = 0.0
    for value in values:
        found += value
    return found
"""
_NUMBERS = count()


def small_kernel(folder, stamp="the stamp"):
    """A kernel of a file of its own, as a new process would compile or load it."""
    file = folder / "small.py"
    if not file.exists():
        file.write_text(KERNEL)
    spec = importlib.util.spec_from_file_location(f"small_{next(_NUMBERS)}", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    compiled = mbvi.compiled.cache.Code(module.total, "f8(f8[::1])", stamp, lambda wait: True, lambda: None).entry()
    return compiled, not sum(compiled.stats.cache_hits.values())


@pytest.fixture
def small_cache(tmp_path, monkeypatch):
    import mbvi.compiled.cache

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(mbvi.compiled.cache, "_said", set())
    return tmp_path


def records_of_mbvi(caplog):
    """What mbvi has said; other libraries log from threads of their own whenever the machine is slow."""
    return [record for record in caplog.records if record.name.startswith("mbvi")]


def flipped(data, k):
    return data[:k] + bytes([data[k] ^ 0x10]) + data[k + 1 :]


DAMAGES = {
    "empty": lambda data, rng: b"",
    "halved": lambda data, rng: data[: len(data) // 2],
    "cut by one byte": lambda data, rng: data[:-1],
    "garbage": lambda data, rng: rng.bytes(len(data)),
    "garbage behind a good head": lambda data, rng: data[:60] + rng.bytes(len(data) - 60),
    "zeros": lambda data, rng: bytes(len(data)),
    "longer": lambda data, rng: data + rng.bytes(100),
    "a byte flipped": lambda data, rng: flipped(data, int(rng.integers(len(data)))),
    "a pickle of something else": lambda data, rng: __import__("pickle").dumps({"a": 1}),
}


@pytest.mark.parametrize("damage", DAMAGES, ids=DAMAGES)
@pytest.mark.parametrize("kinds", [("nbi",), ("nbc",), ("nbi", "nbc")], ids="+".join)
@pytest.mark.parametrize("function_too", [False, True])
def test_a_damaged_file_is_named_and_its_kernel_compiled_again(small_cache, damage, kinds, function_too, rng, caplog):
    kernel, new = small_kernel(small_cache)
    assert new
    assert not small_kernel(small_cache)[1]
    assert not records_of_mbvi(caplog)
    files = [file for kind in kinds for file in entries(small_cache, kind)]
    assert len(files) == len(kinds)
    if function_too:
        files += [file for kind in kinds for file in small_cache.rglob(f"*.function.*{kind}")]
        assert len(files) == 2 * len(kinds)
    for file in files:
        file.write_bytes(DAMAGES[damage](file.read_bytes(), rng))
    values = rng.random(10)
    again, new = small_kernel(small_cache)
    assert again(values) == kernel(values)
    assert new
    said = caplog.text
    # behind a damaged index nobody looks for the other
    assert f"{files[0]} is damaged" in said
    # and what was compiled is in the cache
    caplog.clear()
    last, _ = small_kernel(small_cache)
    assert sum(last.stats.cache_hits.values()) == 1
    assert not records_of_mbvi(caplog)


def test_a_folder_in_the_place_of_a_file_does_not_stop_a_run(small_cache, caplog):
    small_kernel(small_cache)
    for file in [*small_cache.rglob("*.nbi")]:
        file.unlink()
        file.mkdir()
    kernel, _ = small_kernel(small_cache)
    assert kernel(np.ones(3)) == 3.0
    said = caplog.text
    assert "is damaged" in said
    assert "compiled kernels cannot be kept in" in said


def test_a_disk_that_fills_while_the_cache_is_written_does_not_stop_a_run(small_cache, caplog):
    """The limit on the size of files stands for the disk: it needs no other file system."""
    import resource

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
    try:
        kernel, _ = small_kernel(small_cache)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert kernel(np.ones(3)) == 3.0
    assert "compiled kernels cannot be kept in" in caplog.text
    assert not [*small_cache.rglob("*.nbc"), *small_cache.rglob("*.tmp.*")]
    # the index that was written names a file that is not there
    # numba looks for the module of what it reads, which a kernel of no module only has as long as another is kept
    again, _ = small_kernel(small_cache)
    assert again(np.ones(3)) == 3.0
    assert sum(small_kernel(small_cache)[0].stats.cache_hits.values()) == 1


def test_ctrl_c_is_held_back_and_never_lost():
    """Where Python is called from compiled code the interrupt would be printed and forgotten."""
    before = signal.getsignal(signal.SIGINT)
    done = 0
    # a kernel that is compiled may compile others
    with pytest.raises(KeyboardInterrupt), interruptible(), interrupts_later():
        with interrupts_later():
            os.kill(os.getpid(), signal.SIGINT)
            done = sum(range(1000))
        done += 1
    assert done == 499501
    assert signal.getsignal(signal.SIGINT) is before
    # elsewhere than in the main thread nobody may set a handler
    found = []

    def enter():
        with interrupts_later():
            found.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert found == [before]


INTERRUPTED = """
import sys
import mbvi.compiled
print("loading", flush=True)
LOAD
print("loaded", flush=True)
sys.stdin.read()
"""


def interrupted(delay, load="mbvi.compiled.compile_all()", ready=lambda: True, **environment):
    """Send Ctrl-C a time after loading began and `ready()`; return what was printed to both ends, and the code."""
    command, pipe = [sys.executable, "-c", INTERRUPTED.replace("LOAD", load)], subprocess.PIPE
    with started(command, stdin=pipe, env=os.environ | environment) as child:
        assert child.stdout.readline() == "loading\n"
        wait_until(ready, "nothing is compiled")
        time.sleep(delay)
        child.send_signal(signal.SIGINT)
        out, said = child.communicate(timeout=LIMIT)
    return out, said, child.returncode


@pytest.mark.parametrize("delay", [0.05, 0.3, 0.5, 0.7])
def test_ctrl_c_while_kernels_load_stops_the_process(delay):
    out, said, code = interrupted(delay)
    # whether it comes before the end or after, the process ends with it
    assert out in ("", "loaded\n")
    assert "KeyboardInterrupt" in said
    assert "ignored" not in said
    assert code == -signal.SIGINT


def names_of_read(folder):
    """The kernels that the box on a floor reads from a folder, as their files begin."""
    return process(LANDING + RUN + LOADED, NUMBA_CACHE_DIR=str(folder))[0].splitlines()[-1].split()


@pytest.mark.slow
def test_ctrl_c_while_kernels_are_compiled_leaves_a_cache_that_works(landing, tmp_path):
    """Of those that a run needs all are missing but the loop, which takes most of the time to compile."""
    folder, expected, _ = landing
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    names = [name for name in names_of_read(folder) if not name.startswith("step_loop.")]
    for file in tmp_path.rglob("*.nb?"):
        if file.name.split("-")[0] in names:
            file.unlink()
    kept = {*entries(tmp_path)}
    load = f"for item in mbvi.compiled.all_kernels():\n    if {NAME} in {names}:\n        item.compiled()"
    for least in (0, 2, 4):
        out, said, code = interrupted(
            0.3, load, lambda least=least: len({*entries(tmp_path)} - kept) >= least, NUMBA_CACHE_DIR=str(tmp_path)
        )
        assert (out, code) == ("", -signal.SIGINT)
        assert "KeyboardInterrupt" in said
        assert "ignored" not in said
    assert 4 <= len({*entries(tmp_path)} - kept) < len(names)
    assert not [*tmp_path.rglob("*.tmp.*")]
    # the run reads what was kept, and compiles the one that was interrupted and the others
    found, said = process(LANDING + RUN, NUMBA_CACHE_DIR=str(tmp_path))
    assert found == expected
    assert said.startswith("compiling")
    assert "damaged" not in said


@pytest.mark.slow
def test_a_run_with_damaged_kernels_is_the_same_run(landing, tmp_path, rng):
    folder, expected, _ = landing
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    read = names_of_read(tmp_path)
    files = sorted(entries(tmp_path, "nb?"))
    # of five kernels one file each that the run reads, and any four others, of which it may read none
    chosen = [
        file
        for name in rng.choice(read, 5, replace=False)
        for file in rng.choice([file for file in files if file.name.startswith(f"{name}-")], 1)
    ]
    chosen += rng.choice([file for file in files if file not in chosen], 4, replace=False).tolist()
    for file in chosen:
        damage = list(DAMAGES)[int(rng.integers(len(DAMAGES)))]
        file.write_bytes(DAMAGES[damage](file.read_bytes(), rng))
    found, said = process(LANDING + RUN, NUMBA_CACHE_DIR=str(tmp_path))
    assert found == expected
    assert said.count("is damaged") >= 5
    assert process(LANDING + RUN, NUMBA_CACHE_DIR=str(tmp_path)) == (expected, "")
