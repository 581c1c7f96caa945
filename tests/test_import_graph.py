"""The import graph has no circle, rooms import only from rooms below, and studies stand on top; sizes of modules."""

import ast
from collections import Counter
from functools import cache

import pytest

from support.paths import ROOT

PACKAGES = ("mbvi", "mbvi_studies")

# the rooms of docs/developer/architecture.md from the lowest floor up; "mbvi" is the __init__ of the package, and
# mbvi_studies one room
FLOORS = (
    "errors", "arguments", "compiled", "geometry", "projection", "system", "constraints", "impacts", "built_scene",
    "problem", "schemes", "schemes.event_driven", "scene", "results.replay", "results", "run", "derivatives", "interop",
    "packing", "reference", "shipped", "sweeps", "mbvi", "cli", "__main__", "mbvi_studies",
)  # fmt: skip
# these rooms are folders inside a room; all other folders belong to the room around them
INNER = {"schemes.event_driven", "results.replay"}


def modules():
    """Each module by its name without "mbvi."; the packages themselves are "mbvi" and "mbvi_studies"."""
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts).removeprefix("mbvi."), path


PATHS = dict(modules())


@cache
def tree(name):
    return ast.parse(PATHS[name].read_text())


def is_type_checking(node):
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)


@cache
def imports(name, *, types):
    """The modules that a module imports, also inside functions, and for types alone if `types`."""
    path = PATHS[name]
    package = path.relative_to(ROOT).parent.parts
    nodes, found = [tree(name)], set()
    while nodes:
        node = nodes.pop()
        if is_type_checking(node) and not types:
            nodes += node.orelse
            continue
        nodes += ast.iter_child_nodes(node)
        targets = []
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ".".join([*package[: len(package) - node.level + 1], *filter(None, [node.module])])
            base = base if node.level else str(node.module)
            targets = [f"{base}.{alias.name}" for alias in node.names]
            # names of a package that are no modules come from its __init__
            targets = [t if t.removeprefix("mbvi.") in PATHS else base for t in targets]
        for target in targets:
            if target.split(".")[0] in PACKAGES:
                short = target.removeprefix("mbvi.")
                # `import mbvi.a.b` of a name in a module ends at the module
                while short not in PATHS and "." in short:
                    short = short.rpartition(".")[0]
                found.add(short)
    return found - {name}


def room(name):
    parts = name.split(".")
    return ".".join(parts[:2]) if ".".join(parts[:2]) in INNER else parts[0]


def circle(arrows):
    """Some circle in a graph, as a list of nodes; empty if there is none."""
    done, path = set(), []

    def visit(node):
        if node in path:
            return [*path[path.index(node) :], node]
        if node in done:
            return []
        path.append(node)
        for target in sorted(arrows.get(node, ())):
            found = visit(target)
            if found:
                return found
        path.pop()
        done.add(node)
        return []

    for node in sorted(arrows):
        found = visit(node)
        if found:
            return found
    return []


def room_arrows(types):
    """Imports between rooms; a room's own __init__ may export what a folder inside the room holds."""
    found = {}
    for name in PATHS:
        for target in imports(name, types=types):
            ours, theirs = room(name), room(target)
            exported = PATHS[name].name == "__init__.py" and theirs.startswith(f"{ours}.")
            if ours != theirs and not exported:
                found.setdefault(ours, {}).setdefault(theirs, f"{name} imports {target}")
    return found


def test_a_circle_is_found():
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert circle({"a": {"b", "c"}, "b": {"c"}}) == []


@pytest.mark.parametrize("types", [False, True], ids=["at run time", "types too"])
def test_no_modules_import_in_a_circle(types):
    # a package's __init__ stands for its exports: `from . import sibling` and the exports themselves are no circle
    arrows = {name: imports(name, types=types) for name in PATHS}
    assert sum(map(len, arrows.values())) > 500
    assert circle(arrows) == []


@pytest.mark.parametrize("types", [False, True], ids=["at run time", "types too"])
def test_rooms_import_only_from_rooms_below(types):
    arrows = room_arrows(types)
    assert circle({name: set(targets) for name, targets in arrows.items()}) == []
    floor = {name: k for k, name in enumerate(FLOORS)}
    assert {room(name) for name in PATHS} <= set(floor)
    upwards = [why for name, targets in arrows.items() for to, why in targets.items() if floor[to] >= floor[name]]
    assert upwards == []


def test_modules_and_folders_are_small_enough_to_be_read():
    paths = sorted((ROOT / "mbvi").rglob("*.py"))
    assert [path for path in paths if len(path.read_text().splitlines()) > 350] == []
    beside = Counter(path.parent for path in paths)
    assert [folder for folder, count in beside.items() if count > 15] == []
