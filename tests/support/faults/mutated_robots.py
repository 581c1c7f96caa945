"""Robot descriptions with one to three faults: mutations of the project's URDFs, and what becomes of them.

A mutated URDF may raise `MbviError` when it is added, built or run; one that is taken must run for ten steps with
finite states or raise `MbviError`. Pinocchio's parsers can end the process, so that each batch is tried in one of its
own.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from support.paths import ROBOTS
from support.programs import environment

URDFS = sorted(ROBOTS.glob("*/*.urdf"))
# seconds of CPU time for one robot; of real time it may take ten times as many on a busy machine
_PATIENCE = 20

VALUES = (
    "", " ", "nan", "inf", "-inf", "-1", "0", "-0.0", "1", "abc", "1e308",
    "-1e308", "1e400", "1e-320", "1e-200", "1e30",
    "1,5", "1_0", "0x10", "1e", "--1", "٣", "1 2", "1 2 3", "1 2 3 4", "0 0 0", "0 0 0 0", "nan nan nan", "1e308 0 0",
    "1e-300 1e-300 1e-300", "-1 -1 -1", "0 1e200 0", "a/b", "a|b", "a[0]", "world", "x" * 5000, "\u00e9", "\n", "true",
)  # fmt: skip
TYPES = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar", "spherical", "ball", "", "Revolute")
GEOMETRIES = (
    '<mesh filename="nowhere.stl"/>', '<mesh filename=""/>', '<mesh/>', '<mesh filename="/" scale="1 1 1"/>',
    '<mesh filename="cube.obj"/>', '<mesh filename="cube.obj" scale="0 0 0"/>',
    '<mesh filename="cube.obj" scale="1 1 0"/>',
    '<mesh filename="cube.obj" scale="-1 1 1"/>', '<mesh filename="cube.obj" scale="1e100 1 1"/>',
    '<mesh filename="cube.obj" scale="1e-30 1 1"/>', '<mesh filename="cube.obj" scale="nan 1 1"/>',
    '<mesh filename="cube.obj" scale="1e-45 1e-45 1e-45"/>', '<mesh filename="cube.obj" scale="1e39 1e39 1e39"/>',
    '<mesh filename="flat.obj"/>', '<mesh filename="empty.obj"/>', '<mesh filename="text.stl"/>',
    '<mesh filename="huge.obj"/>', '<mesh filename="nan.obj"/>', '<capsule radius="0.1" length="0.2"/>',
    '<capsule radius="-0.0" length="0.2"/>', '<cylinder radius="-0.0" length="1"/>', '<sphere radius="1e-320"/>',
    '<sphere radius="1e39"/>', '<box size="1e-39 1 1"/>', '<box size="1 1"/>', '<torus radius="1"/>', "<box/>",
    "<sphere/>", "<cylinder/>", "", '<sphere radius="0.1"/><box size="1 1 1"/>',
)  # fmt: skip
_CUBE = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
_FACES = ((1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2), (3, 4, 8), (3, 8, 7), (1, 3, 7),
          (1, 7, 5), (2, 6, 8), (2, 8, 4))  # fmt: skip


def write_meshes(folder: Path) -> None:
    """Write the mesh files that `GEOMETRIES` name."""
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in _FACES)

    def obj(points: Sequence[Sequence[object]]) -> str:
        return "".join("v {} {} {}\n".format(*p) for p in points) + faces

    (folder / "cube.obj").write_text(obj([[0.1 * x for x in p] for p in _CUBE]))
    (folder / "flat.obj").write_text(obj([(x, y, 0) for x, y, _ in _CUBE]))
    (folder / "huge.obj").write_text(obj([[f"{x}e300" for x in p] for p in _CUBE]))
    (folder / "nan.obj").write_text(obj([("nan", y, z) for _, y, z in _CUBE]))
    (folder / "empty.obj").write_text("")
    (folder / "text.stl").write_text("no mesh at all")


def _elements(root: ElementTree.Element) -> list[tuple[ElementTree.Element, ElementTree.Element]]:
    """Return every element but the root, each with its parent."""
    return [(parent, child) for parent in root.iter() for child in parent]


def _pick(rng: np.random.Generator, items: Sequence[Any]) -> Any:
    return items[int(rng.integers(len(items)))]


def _attribute(rng: np.random.Generator, root: ElementTree.Element) -> str:
    element = _pick(rng, [e for e in root.iter() if e.attrib])
    name = _pick(rng, sorted(element.attrib))
    value = _pick(rng, VALUES)
    element.set(name, value)
    return f"{element.tag} {name}={value[:30]!r}"


def _one_number(rng: np.random.Generator, root: ElementTree.Element) -> str:
    """One number of several gets another magnitude or sign."""
    element = _pick(
        rng, [e for e in root.iter() if {"xyz", "rpy", "size", "rgba", "value", "ixx", "radius"} & set(e.attrib)]
    )
    name = _pick(rng, sorted(element.attrib))
    words = element.attrib[name].split() or ["0"]
    k = int(rng.integers(len(words)))
    words[k] = repr(
        float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(*_pick(rng, [(-3, 3), (-45, 45), (-320, 308)])))
    )
    element.set(name, " ".join(words))
    return f"{element.tag} {name}={element.attrib[name]}"


def _without_attribute(rng: np.random.Generator, root: ElementTree.Element) -> str:
    element = _pick(rng, [e for e in root.iter() if e.attrib])
    name = _pick(rng, sorted(element.attrib))
    del element.attrib[name]
    return f"{element.tag} without {name}"


def _without_element(rng: np.random.Generator, root: ElementTree.Element) -> str:
    parent, child = _pick(rng, _elements(root))
    parent.remove(child)
    return f"{parent.tag} without {child.tag}"


def _twice(rng: np.random.Generator, root: ElementTree.Element) -> str:
    parent, child = _pick(rng, _elements(root))
    parent.append(child)
    return f"{child.tag} twice in {parent.tag}"


def _moved(rng: np.random.Generator, root: ElementTree.Element) -> str:
    parent, child = _pick(rng, _elements(root))
    inside = set(child.iter())
    other = _pick(rng, [e for e in root.iter() if e not in inside])
    parent.remove(child)
    other.append(child)
    return f"{child.tag} from {parent.tag} into {other.tag}"


def _renamed(rng: np.random.Generator, root: ElementTree.Element) -> str:
    _, child = _pick(rng, _elements(root))
    before = child.tag
    child.tag = _pick(rng, ["thing", "link", "joint", "inertia", "Link", "robot", "origin"])
    return f"{before} becomes {child.tag}"


def _rewired(rng: np.random.Generator, root: ElementTree.Element) -> str:
    """A parent or child is another link, often one that closes a cycle, or none at all."""
    ends = [e for e in root.iter() if e.tag in ("parent", "child")]
    links = [e.get("name", "") for e in root.iter("link")]
    if not ends:
        return "nothing to rewire"
    end = _pick(rng, ends)
    end.set("link", _pick(rng, [*links, "nobody", ""]))
    return f"{end.tag} is {end.get('link')!r}"


def _typed(rng: np.random.Generator, root: ElementTree.Element) -> str:
    joints = [e for e in root.iter("joint") if "type" in e.attrib]
    if not joints:
        return "no joint"
    joint = _pick(rng, joints)
    joint.set("type", _pick(rng, TYPES))
    return f"joint {joint.get('name')} is {joint.get('type')!r}"


def _shaped(rng: np.random.Generator, root: ElementTree.Element) -> str:
    places = [e for e in root.iter("geometry")]
    if not places:
        return "no geometry"
    place, text = _pick(rng, places), _pick(rng, GEOMETRIES)
    for child in list(place):
        place.remove(child)
    place.extend(ElementTree.fromstring(f"<g>{text}</g>"))
    return f"geometry {text}"


def _massive(rng: np.random.Generator, root: ElementTree.Element) -> str:
    """Masses and moments all times one factor: the motion is the same, or a number is refused."""
    factor = 10.0 ** float(rng.choice([-300, -100, -45, -30, -9, 9, 30, 45, 100, 300]))
    for element in root.iter():
        for name in ("value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
            try:
                element.set(name, repr(float(element.attrib[name]) * factor))
            except (KeyError, ValueError):
                continue
    return f"masses and moments times {factor:g}"


def _mimicked(rng: np.random.Generator, root: ElementTree.Element) -> str:
    joints = [e for e in root.iter("joint")]
    if not joints:
        return "no joint"
    names = [e.get("name", "") for e in joints]
    ElementTree.SubElement(
        _pick(rng, joints), "mimic",
        {"joint": _pick(rng, [*names, "nobody"]), "multiplier": _pick(rng, VALUES), "offset": _pick(rng, VALUES)},
    )  # fmt: skip
    return "mimic"


def _long(rng: np.random.Generator, root: ElementTree.Element) -> str:
    """A chain of many links behind the last one."""
    count = int(_pick(rng, [3, 60]))
    last = next(root.iter("link")).get("name", "")
    for k in range(count):
        link = ElementTree.SubElement(root, "link", name=f"extra{k}")
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "mass", value="0.1")
        ElementTree.SubElement(inertial, "inertia", ixx="1e-4", ixy="0", ixz="0", iyy="1e-4", iyz="0", izz="1e-4")
        joint = ElementTree.SubElement(root, "joint", name=f"more{k}", type="continuous")
        ElementTree.SubElement(joint, "parent", link=last)
        ElementTree.SubElement(joint, "child", link=f"extra{k}")
        ElementTree.SubElement(joint, "origin", xyz="0 0 0.1")
        ElementTree.SubElement(joint, "axis", xyz="1 0 0")
        last = f"extra{k}"
    return f"{count} more links"


OF_TREES: tuple[Callable[[np.random.Generator, ElementTree.Element], str], ...] = (
    _attribute, _attribute, _attribute, _attribute, _one_number, _one_number, _one_number, _without_attribute,
    _without_element, _without_element, _twice, _moved, _renamed, _rewired, _rewired, _typed, _shaped, _shaped,
    _massive, _mimicked, _long,
)  # fmt: skip


def _cut(rng: np.random.Generator, data: bytes) -> tuple[str, bytes]:
    end = int(rng.integers(len(data)))
    return f"cut at byte {end}", data[:end]


def _flipped(rng: np.random.Generator, data: bytes) -> tuple[str, bytes]:
    changed = bytearray(data)
    for k in rng.integers(len(data), size=int(_pick(rng, [1, 3, 30]))).tolist():
        changed[k] = int(rng.integers(256))
    return "bytes flipped", bytes(changed)


def _encoded(rng: np.random.Generator, data: bytes) -> tuple[str, bytes]:
    text = data.decode().replace('name="', 'name="\u00e9', 1)
    declared, real = _pick(rng, [
        ("utf-8", "utf-16"), ("utf-16", "utf-16"), ("latin-1", "latin-1"), ("utf-8", "latin-1"), ("latin-1", "utf-8"),
        ("nonsense", "utf-8"), ("utf-7", "utf-8"), ("", "utf-8-sig"), ("utf-32", "utf-32"), ("base64", "utf-8"),
    ])  # fmt: skip
    head = f'<?xml version="1.0" encoding="{declared}"?>' if declared else "<?xml version='1.0'?>"
    return f"declared {declared!r}, written in {real}", (head + text.partition("?>")[2]).encode(real)


def _inserted(rng: np.random.Generator, data: bytes) -> tuple[str, bytes]:
    k = int(rng.integers(len(data)))
    what = _pick(
        rng, [b"\0", b"\xff", b"<", b">", b"&", b'"', b"]]>", b"<!--", b"<![CDATA[", b"&amp;", b"<robot>", b"&x;"]
    )
    return f"{what!r} at byte {k}", data[:k] + what + data[k:]


def _deep(rng: np.random.Generator, data: bytes) -> tuple[str, bytes]:
    depth, tag = int(_pick(rng, [10, 600, 100_000])), _pick(rng, [b"origin", b"link", b"robot"])
    inside = b"<" + tag + b">"
    end = _pick(rng, [b"</link>", b"</robot>"])
    before, _, after = data.partition(end)
    return f"{depth} {tag!r} inside each other", before + inside * depth + inside.replace(
        b"<", b"</"
    ) * depth + end + after


def _bomb(rng: np.random.Generator, data: bytes) -> tuple[str, bytes]:
    names = "abcdefghij"
    entities = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise(names))
    head = f'<?xml version="1.0"?><!DOCTYPE robot [<!ENTITY a "x">{entities}]>'
    return "entities inside each other", head.encode() + data.partition(b"?>")[2].replace(b"</robot>", b"&j;</robot>")


OF_BYTES: tuple[Callable[[np.random.Generator, bytes], tuple[str, bytes]], ...] = (
    _cut, _flipped, _flipped, _encoded, _inserted, _bomb, _deep
)  # fmt: skip


def mutation(rng: np.random.Generator) -> tuple[str, bytes]:
    """Return in words what was done to one of the robots, and the file's bytes."""
    source = _pick(rng, URDFS)
    data = source.read_bytes()
    if rng.random() < 0.15:
        said, data = _pick(rng, OF_BYTES)(rng, data)
        return f"{source.stem}: {said}", data
    root = ElementTree.fromstring(data)
    done = [_pick(rng, OF_TREES)(rng, root) for _ in range(int(_pick(rng, [1, 1, 1, 2, 3])))]
    return f"{source.stem}: {'; '.join(done)}", b'<?xml version="1.0"?>\n' + ElementTree.tostring(root)


def attempt(path: Path, base: str) -> str:
    """Add, build and run a robot above a floor; return what became of it, "taken" or the `MbviError`'s kind."""
    import mbvi

    try:
        scene = mbvi.Scene()
        scene.add_halfspace((0, 0, 1), offset=-5.0)
        scene.add_urdf(path, base=base)
        problem = scene.build()
        problem.report()
        run = mbvi.simulate(problem, mbvi.Centered(project_positions=True), step=1e-3, duration=1e-2, progress=False)
    except mbvi.MbviError as error:
        assert str(error)
        return type(error).__name__
    assert np.isfinite(run.q).all() and np.isfinite(run.v).all(), "states that are not finite"
    return "taken"


def main(folder: str, first: str) -> None:
    """Try the robots of a folder from the number `first` on; print one line of JSON each."""
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", "zmq.eventloop.ioloop is deprecated")
    import mbvi
    from mbvi.compiled import compile_all

    warnings.simplefilter("ignore", mbvi.MbviWarning)
    # which may take longer than any robot
    compile_all()
    for path in sorted(Path(folder).glob("*.urdf"))[int(first) :]:
        for base in ("free", "fixed"):
            # the process ends where even C++ does not return
            signal.setitimer(signal.ITIMER_PROF, _PATIENCE)
            signal.alarm(10 * _PATIENCE)
            try:
                outcome = attempt(path, base)
            except Exception as error:
                outcome = f"raw {type(error).__name__}: {error}"
            print(json.dumps([path.name, base, outcome[:500]]), flush=True)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.alarm(0)


def outcomes(folder: Path, cases: Sequence[tuple[str, bytes]], program: Path = Path(__file__)) -> list[tuple[str, str]]:
    """Try mutated robots in a process of its own.

    Parameters
    ----------
    folder : Path
        An empty folder for their files.
    cases : sequence of (str, bytes)
        As `mutation` returns them.
    program : Path
        What the process runs, with the folder and a number.

    Returns
    -------
    list of (str, str)
        What was done to each, and what became of it with a free and with a fixed base: "taken", the kind of an
        `MbviError`, or "raw ...", "killed ..." for what may not happen.
    """
    write_meshes(folder)
    for k, (_, data) in enumerate(cases):
        (folder / f"{k:06d}.urdf").write_bytes(data)
    found: list[tuple[str, str]] = []
    done = 0
    while done < len(cases):
        child = subprocess.run(
            [sys.executable, str(program), str(folder), str(done)],
            capture_output=True,
            text=True,
            timeout=3600,
            env=environment(),
            check=False,
        )
        lines = [json.loads(line) for line in child.stdout.splitlines() if line.startswith("[")]
        found += [(f"{name}, {base} base: {cases[int(name[:6])][0]}", outcome) for name, base, outcome in lines]
        done += len(lines) // 2
        if child.returncode:
            found.append((f"{done:06d}.urdf: {cases[done][0]}", f"killed {child.returncode}: {child.stderr[-300:]}"))
            done += 1
    return found


def wrong(found: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return those outcomes that may not happen."""
    return [(said, outcome) for said, outcome in found if outcome.startswith(("raw ", "killed "))]


if __name__ == "__main__":
    main(*sys.argv[1:])
