"""The gallery of the docs: pictures and replays of the examples' own runs, with the number that each returns.

    python benchmarks/gallery.py                 # all pictures of docs/gallery, and docs/gallery.md
    python benchmarks/gallery.py drum heap       # only these pictures
    python benchmarks/gallery.py demo            # only the replay of the first page
    python benchmarks/gallery.py --page          # only the page

Needs Chromium, and Pillow. A picture is taken as `replay_video` takes it.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import gzip
import importlib.util
import io
import json
import sys
import tempfile
import zlib
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np

import mbvi
from mbvi.results.replay.page import Page
from mbvi.results.replay.replay import page_of
from mbvi.results.replay.video import pictures
from mbvi.shipped import demo_problem

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES, FOLDER, PAGE = ROOT / "examples", ROOT / "docs/gallery", ROOT / "docs/gallery.md"
NUMBERS, REPLAYS = FOLDER / "numbers.json", ROOT / "docs/replays"
WIDTH, HEIGHT, QUALITY = 420, 280, 60
# bytes of a replay beyond which it has no visual meshes
LARGEST = 200_000


class Shown(NamedTuple):
    """An example of the gallery.

    Attributes
    ----------
    name : str
        Of its file, without ".py".
    says : str
        What the number is, which stands behind it on the page.
    start, end : float
        Part of the run that is shown [s].
    frames : int
        Number of pictures; one is a still picture of the end.
    page : str
        How its replay is written, after "python examples/...": the name of a page.
    """

    name: str
    says: str
    start: float
    end: float
    frames: int = 1
    page: str = ""


SECTIONS = {
    "Robots": [
        Shown("drop_robot", "m/s: speed at which the foot strikes first; its fall says 3.223", 0, 1.2, 20),
        Shown("quadruped_on_slope", "m: creep in half a second of standing on 15 degrees", 2.4, 3.3, 18, "walk.html"),
        Shown("robot_on_stairs", ": impulse of stairs and floor over weight and momentum", 0, 1.6, 20, "stairs.html"),
        Shown("hop_on_touchdown", "m: height of the trunk at the top of a hop that touchdown starts", 0, 1.0, 16),
        Shown("sampled_jump", "m: height that the trunk gains by sampled torques", 0, 0.35, 12, "jump.html"),
        Shown("arm_joint_limit", "N m s: the strongest percussion at a joint limit", 0, 0.6, 14),
        Shown("foot_in_gravel", "m/s: speed of the foot at its first stone", 0, 0.4, 12, "gravel.html"),
        Shown("four_bar", "s: a loop of four hinges strikes the floor", 0, 1.2, 24, "linkage.html"),
        Shown("cassie_landing", ": percussions under Cassie's feet over weight and momentum", 0, 1, 20, "landing.html"),
        Shown("parallel_gripper", "N: push of a mimic joint in a grip; half the motor's 16", 0, 0.85, 18, "lift.html"),
        Shown("panda_throws_ball", "m: miss of a ball that a gripper holds and throws", 1.2, 2.4, 16, "throw.html"),
        Shown(
            "mixed_heap", ": percussions of the floor, over weight times duration plus gain of momentum: 1", 0, 0.5, 12,
            "mixed.html",
        ),
    ],
    "Grains and boxes": [
        Shown("hourglass", "of 120 spheres have passed: without friction no arch is stable", 0, 3, 16, "glass.html"),
        Shown("arch", "of 60 grains stay above the neck at mu = 0.5", 0, 0.8, 12, "arch.html"),
        Shown("avalanche", "m: travel of the centre of mass; g sin(angle) T^2 / 2 = 1.327", 0, 0.8, 12, "slide.html"),
        Shown("heap", "degrees: angle of repose of discs at mu = 0.5, mean of three heaps", 0, 0.6, 12, "heap.html"),
        Shown("drum", ": (gain + losses) / work of a drum with spheres; 1 to rounding", 0, 2, 16, "drum.html"),
        Shown("box_drum", ": the same, boxes in a drum of plates; 1 to the order of the step", 0, 0.8, 12, "box.html"),
        Shown("box_hopper", ": part of the boxes that has passed; none stays", 0, 0.8, 12, "hopper.html"),
        Shown("shaker", "s: a bed of spheres lands; the end of its free flight is 0.2063", 0, 0.4, 10, "shaker.html"),
        Shown("box_shaker", "s: a bed of boxes lands; the end of its free flight is 0.2063", 0, 0.4, 10, "shaker.html"),
        Shown("boxes_at_rest", "m g d: energy of a poured box with friction; all sleep", 0, 1.2, 12, "rest.html"),
        Shown("dominoes", "m/s: speed of the wave; finer steps give 0.845", 0, 0.6, 14, "dominoes.html"),
        Shown("boxes_hit_by_ball", "N s: a ball hits a stack at rest; by hand 4.8", 0.1, 0.6, 16),
    ],
}  # fmt: skip
# pictures that examples draw by themselves, and numbers that their tests pin
DRAWN = {
    "Impacts": [
        (
            "figure_1",
            "theory/figure_1.png",
            "0.707 m between points that started 1 cm apart and met an obtuse corner",
        ),
        ("error_control", "benchmarks/error_control.png", "0.189962172 s: first impact of a dropped quadruped"),
    ],
    "Many runs": [
        ("rocking_block", "howto/rocking_block.png", "0.9968 of 10 000 starts end as Housner's energies say"),
        ("thrown_die", "howto/thrown_die.png", "1/6: each face of a thrown die, within 0.011, in 4096 throws"),
    ],
}
WITHOUT = {
    "given_functions": "a double pendulum beside a wall, by M, g and f as functions",
    "painleve_rod": "Painlevé's rod: after its end has jammed it turns at 1.2622 rad/s, as by hand",
    "bowl": "a ball slides and rolls through a bowl made as a height field, against pendulums",
    "quadruped_on_rubble": "a quadruped stands on random stones, a height field, and is pushed",
    "funnel": "a thousand grains run through a funnel that is read from an STL file",
    "step_by_hand": "one step at a time",
    "find_restitution": "the restitution of a ball, from a recording of its bounces",
    "bank_shot": "a throw that is at a mark in time after three impacts: 7 runs with derivatives, 25 without",
    "hopper_launch": "a hopper that is at a mark after three impacts: 7 runs with derivatives, 28 without",
    "find_gains": "the gains of a drive, from a recording of its joint at a wall, by a gradient of one pass back",
    "keep_hopping": "a linear-quadratic regulator through landings keeps a hopper hopping after a blow",
    "hopper_environment": "the interface of gymnasium",
    "viser_viewer": "a run in the viewer viser, with a slider for the time",
}


def loaded(name: str) -> ModuleType:
    """Return an example as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def number_and_run(shown: Shown) -> tuple[float, mbvi.Trajectory]:
    """Return the number of an example, and the last of its runs."""
    runs, simulate = [], mbvi.simulate

    def kept(*arguments: object, **options: object) -> mbvi.Trajectory:
        runs.append(simulate(*arguments, **options))  # type: ignore[arg-type]
        return runs[-1]

    mbvi.simulate = kept  # type: ignore[assignment]
    try:
        with contextlib.redirect_stdout(io.StringIO()), tempfile.TemporaryDirectory() as folder:
            with contextlib.chdir(folder):
                arguments = [shown.page] if shown.page else []
                return float(loaded(shown.name).main(*arguments)), runs[-1]
    finally:
        mbvi.simulate = simulate


def draw(shown: Shown) -> float:
    """Write the picture of an example, and return its number."""
    from PIL import Image

    number, run = number_and_run(shown)
    end = min(shown.end, float(run.t[-1]))
    times = np.linspace(shown.start, end, shown.frames) if shown.frames > 1 else np.array([end])
    taken = pictures(run, times - run.t[0], width=WIDTH, height=HEIGHT)
    first, *rest = (Image.open(io.BytesIO(one)).convert("RGB") for one in taken)
    # an animation stays at its end for a second
    pause = [1000 * (end - shown.start) / max(shown.frames - 1, 1) * 2] * (shown.frames - 1) + [1000]
    write_replay(shown.name, run)
    file = FOLDER / f"{shown.name}.webp"
    first.save(
        file, save_all=True, append_images=rest, duration=[int(p) for p in pause], loop=0, quality=QUALITY, method=6
    )
    print(f"{shown.name}: {number:.6g}, {file.stat().st_size / 1e3:.0f} kB", flush=True)
    return number


def write_replay(name: str, run: mbvi.Trajectory) -> None:
    """Write what the replay of a run shows; the build of the site makes a page of it."""
    shown = packed(page_of(run))
    if len(shown) > LARGEST:
        page = page_of(run, "collision")
        only_collision_shapes(page)
        shown = packed(page)
    REPLAYS.mkdir(exist_ok=True)
    (REPLAYS / f"{name}.json.gz").write_bytes(shown)


def packed(page: Page) -> bytes:
    """Return what a page shows, compressed."""
    return gzip.compress(json.dumps(page.content()).encode(), mtime=0)


def only_collision_shapes(page: Page) -> None:
    """Leave the visual meshes out of a page, which may be large."""
    groups = page.data["groups"]
    kinds = [np.frombuffer(zlib.decompress(base64.b64decode(group["kinds"])), np.uint8) for group in groups]
    number = {str(old): str(new) for new, old in enumerate(k for k, kind in enumerate(kinds) if (kind & 2).any())}
    page.data["groups"] = [groups[int(old)] for old in number]
    kept = []
    for command in page.commands:
        head, instances, rest = str(command["path"]).partition("/instances/")
        old, slash, name = rest.partition("/")
        if not instances:
            kept.append(command)
        elif old in number:
            kept.append({**command, "path": f"{head}{instances}{number[old]}{slash}{name}"})
    page.commands = kept


def card(name: str, picture: str, text: str, command: str) -> str:
    """Return the part of the page that shows one example."""
    # the braces keep formatters of Markdown away from the line that includes the file
    return (
        f"-   ![{name}]({picture}){{ loading=lazy }}\n\n    **{text}**\n\n    `{command}`\n\n"
        f'    ??? note "source"\n\n        ``` {{ .py }}\n        --8<-- "examples/{name}.py"\n        ```\n\n'
    )


def page(numbers: dict[str, float]) -> str:
    """Return the page of the gallery."""
    parts = [
        "# Gallery\n\nEach picture is taken from a run of an example, and each number is what the example returns.\n"
        "Tests compare the numbers with exact values or with the limit of finer steps (`tests/test_examples.py`).\n\n"
        "A picture opens its replay: turn it, and move through time.\n"
        "A command that names a page writes the replay there.\n"
        "`python benchmarks/gallery.py` makes this page and its pictures.\n"
    ]
    for section in dict.fromkeys([*SECTIONS, *DRAWN]):
        parts.append(f'## {section}\n\n<div class="gallery" markdown>\n')
        for shown in SECTIONS.get(section, []):
            number = numbers.get(shown.name, float("nan"))
            text = f"{0 if abs(number) < 1e-12 else number:.4g} {shown.says}".replace(" :", ":")
            command = f"python examples/{shown.name}.py {shown.page}".strip()
            parts.append(card(shown.name, f"gallery/{shown.name}.webp", text, command))
        for name, picture, text in DRAWN.get(section, []):
            parts.append(card(name, picture, text, f"python examples/{name}.py"))
        parts.append("</div>\n")
    parts.append("## Without a picture\n\n| example | shows |\n|---|---|\n")
    parts[-1] += "".join(f"| `examples/{name}.py` | {says} |\n" for name, says in WITHOUT.items())
    return "\n".join(parts)


def main() -> None:
    """Draw what the arguments name."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("names", nargs="*", help="only these examples")
    parser.add_argument("--page", action="store_true", help="only the page")
    options = parser.parse_args()
    FOLDER.mkdir(exist_ok=True)
    numbers = json.loads(NUMBERS.read_text()) if NUMBERS.exists() else {}
    for shown in [] if options.page else [one for part in SECTIONS.values() for one in part]:
        if not options.names or shown.name in options.names:
            numbers[shown.name] = draw(shown)
            NUMBERS.write_text(json.dumps(numbers, indent=1, sort_keys=True) + "\n")
    if not options.page and (not options.names or "demo" in options.names):
        write_replay("demo", mbvi.simulate(demo_problem(), step=1e-3, duration=2.0))
    PAGE.write_text(page(numbers))


if __name__ == "__main__":
    sys.exit(main())
