"""Inject faults: fuzzed scenes, states, controls, URDFs, arguments, files, studies, kills, full disks. `make faults`.

Every case is a seed. Cases run in worker processes, so that a crash or a hang is counted instead of ending the program.
A case is "held" if it gave the right answer, "refused" if mbvi raised one of its own errors, and a fault otherwise:
another exception, a crash, a hang, a wrong number. The exit code is the number of kinds with faults.
"""

from __future__ import annotations

import argparse
import json
import os
import selectors
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

HERE = Path(__file__).resolve()
sys.path.insert(0, str(HERE.parent.parent / "tests"))

# kinds of faults and their shares of the time
SHARES = {
    "scenes": 3.0, "units": 2.0, "urdf": 2.0, "arguments": 1.5, "files": 2.0, "kills": 1.0, "disks": 1.0,
    "rotations": 0.5, "names": 0.5, "controls": 1.0, "gains": 1.0, "pairs": 1.0, "mjcf": 0.5, "studies": 1.0,
    "workers": 2.0,
}  # fmt: skip
# a case without output for this time hangs [s]; in those of "workers" processes start many times
PATIENCE, PATIENCE_WITH_WORKERS = 60.0, 300.0


def work(kind: str, first: int, stride: int) -> None:
    """Run cases first, first + stride, ... of a kind until the driver ends this process; one line of JSON a case."""
    import mbvi
    from support.faults import cases

    case = getattr(cases, kind)
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", mbvi.MbviWarning)
    # wrong arguments may name files
    os.chdir(tempfile.mkdtemp(prefix="mbvi-faults-"))
    seed = first
    while True:
        say({"start": seed})
        try:
            verdict, detail = "held", case(seed)
        except mbvi.MbviError as error:
            verdict, detail = "refused", f"{type(error).__name__}: {error}"
        except AssertionError as error:
            verdict, detail = "wrong", str(error).strip().splitlines()[0] if str(error).strip() else "assertion"
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            verdict, detail = f"raw {type(error).__name__}", f"{error} ({Path(where.filename).name}:{where.lineno})"
        say({"seed": seed, "verdict": verdict, "detail": str(detail or "")[:300]})
        seed += stride


def say(message: dict[str, object]) -> None:
    """Write one line to the driver."""
    os.write(3, (json.dumps(message) + "\n").encode())


class Worker:
    """A process that runs cases of one kind, started again after a crash or a hang."""

    def __init__(self, kind: str, seed: int, stride: int) -> None:
        self.kind, self.seed, self.stride = kind, seed, stride
        self.start()

    def start(self) -> None:
        """Start the process at the next case."""
        read, write = os.pipe()
        os.set_inheritable(write, True)
        command = [sys.executable, str(HERE), "--worker", self.kind, str(self.seed), str(self.stride), str(write)]
        self.process = subprocess.Popen(
            command, pass_fds=(write,), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL
        )
        os.close(write)
        self.pipe, self.rest, self.since = read, b"", time.monotonic()

    def stop(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        os.close(self.pipe)

    def read(self) -> list[dict[str, object]]:
        """Return the output of the process since the last call; a crash counts as a verdict."""
        data = os.read(self.pipe, 65536)
        if not data:
            code = self.process.wait()
            os.close(self.pipe)
            crash = {"seed": self.seed, "verdict": f"crash {code}", "detail": "the process died"}
            self.seed += self.stride
            self.start()
            return [crash]
        self.since = time.monotonic()
        *lines, self.rest = (self.rest + data).split(b"\n")
        found = [json.loads(line) for line in lines]
        for one in found:
            if "verdict" in one:
                self.seed = int(one["seed"]) + self.stride
        return [one for one in found if "verdict" in one]

    def hung(self) -> list[dict[str, object]]:
        """Return the verdict "hang" and go on with the next case if the process has printed nothing for long."""
        patience = PATIENCE_WITH_WORKERS if self.kind == "workers" else PATIENCE
        if time.monotonic() - self.since < patience:
            return []
        self.stop()
        hang = {"seed": self.seed, "verdict": "hang", "detail": f"nothing for {patience:.0f} s"}
        self.seed += self.stride
        self.start()
        return [hang]


def run(kind: str, seed: int, seconds: float, jobs: int) -> tuple[Counter[str], list[dict[str, object]]]:
    """Return how many cases of a kind had which verdict, and the faults."""
    selector, counts, faults = selectors.DefaultSelector(), Counter[str](), []
    workers = [Worker(kind, seed + k, jobs) for k in range(jobs)]
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        selector = selectors.DefaultSelector()
        for worker in workers:
            selector.register(worker.pipe, selectors.EVENT_READ, worker)
        found = [one for key, _ in selector.select(1.0) for one in key.data.read()]
        selector.close()
        for worker in workers:
            found += worker.hung()
        for one in found:
            counts[str(one["verdict"])] += 1
            if one["verdict"] not in ("held", "refused"):
                faults.append(one)
    for worker in workers:
        worker.stop()
    return counts, faults


def main() -> int:
    """Run all kinds, print a table, return how many kinds had faults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=list(SHARES), metavar="KIND", help=", ".join(SHARES))
    parser.add_argument("--seed", type=int, default=0, help="first seed of each kind")
    parser.add_argument("--minutes", type=float, default=13.0, help="total time [min]")
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    parser.add_argument("--case", type=int, help="run only the case of this seed and one kind, in this process")
    asked = parser.parse_args()
    unknown = set(asked.kinds) - set(SHARES)
    if unknown:
        parser.error(f"unknown kinds {sorted(unknown)}; known are {', '.join(SHARES)}")
    if asked.case is not None:
        from support.faults import cases

        print(getattr(cases, asked.kinds[0])(asked.case))
        return 0
    total, bad = sum(SHARES[kind] for kind in asked.kinds), 0
    print(f"{'kind':<10} {'cases':>6} {'held':>6} {'refused':>8} {'faults':>7}")
    for kind in asked.kinds:
        counts, faults = run(kind, asked.seed, 60.0 * asked.minutes * SHARES[kind] / total, asked.jobs)
        print(f"{kind:<10} {counts.total():6} {counts['held']:6} {counts['refused']:8} {len(faults):7}", flush=True)
        for one in faults[:10]:
            print(f"    seed {one['seed']}: {one['verdict']}: {one['detail']}")
        bad += bool(faults)
    return bad


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        kind, first, stride, pipe = sys.argv[2:6]
        if int(pipe) != 3:
            os.dup2(int(pipe), 3)
        work(kind, int(first), int(stride))
    sys.exit(main())
