"""What builds and describes the package says the same as pyproject.toml."""

import re
import tomllib

import pytest

import mbvi
from support.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# names on conda-forge that differ
CONDA = {"pin": "pinocchio", "meshcat": "meshcat-python"}


def test_the_conda_recipe_has_the_version_and_the_requirements_of_the_package():
    yaml = pytest.importorskip("yaml")
    recipe = yaml.safe_load((ROOT / "conda/recipe.yaml").read_text())
    assert recipe["context"]["version"] == PROJECT["version"] == mbvi.__version__
    assert recipe["package"] == {"name": "mbvi", "version": "${{ version }}"}
    asked = dict(line.split(" ", 1) for line in recipe["requirements"]["run"])
    own = dict(re.match(r"([\w-]+)(.*)", line).groups() for line in PROJECT["dependencies"])
    assert asked.pop("python") == PROJECT["requires-python"]
    assert asked == {CONDA.get(name, name): bounds for name, bounds in own.items()}
    assert recipe["about"]["license"] == PROJECT["license"] and recipe["about"]["summary"] == PROJECT["description"]
    assert recipe["build"]["python"]["entry_points"] == [f"mbvi = {PROJECT['scripts']['mbvi']}"]


def test_classifiers_name_the_pythons_from_the_lowest_on():
    found = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", line)]
    assert found and f">={found[0]}" == PROJECT["requires-python"]
    minors = [int(name.partition(".")[2]) for name in found]
    assert minors == list(range(minors[0], minors[0] + len(minors)))


def test_the_changelog_begins_with_the_version():
    first = re.search(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)[1]
    assert first in (mbvi.__version__, "Unreleased")


def test_extras_with_the_same_package_have_the_same_bounds():
    bounds = {}
    for lines in (PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()):
        for line in lines:
            name, bound = re.match(r"([\w.-]+)(.*)", line).groups()
            assert bounds.setdefault(name, bound) == bound
