"""What builds and describes the package says the same as pyproject.toml."""

import importlib.util
import re
import sys
import tomllib
from hashlib import sha256

import pytest

import mbvi
from support.paths import ROOT
from support.programs import run

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# names on conda-forge that differ
CONDA = {"pin": "pinocchio", "meshcat": "meshcat-python"}


def test_the_conda_recipe_has_the_version_and_the_requirements_of_the_package(tmp_path):
    yaml = pytest.importorskip("yaml")
    sdist = tmp_path / "mbvi.tar.gz"
    sdist.write_bytes(b"the sdist")
    done = run([sys.executable, ROOT / "tools/conda_recipe.py", sdist, "owner/name"], env=None)
    assert done.returncode == 0 and "@" not in done.stdout
    recipe = yaml.safe_load(done.stdout)
    assert recipe["source"]["sha256"] == sha256(b"the sdist").hexdigest()
    assert recipe["source"]["url"].endswith("/mbvi-${{ version }}.tar.gz")
    assert recipe["extra"]["recipe-maintainers"] == ["owner"]
    assert recipe["about"]["homepage"] == "https://github.com/owner/name"
    assert recipe["context"]["version"] == PROJECT["version"] == mbvi.__version__
    assert recipe["package"] == {"name": "mbvi", "version": "${{ version }}"}
    asked = dict(line.split(" ", 1) for line in recipe["requirements"]["run"])
    own = dict(re.match(r"([\w-]+)(.*)", line).groups() for line in PROJECT["dependencies"])
    assert asked.pop("python") == ">=${{ python_min }}"
    assert f">={recipe['context']['python_min']}" == PROJECT["requires-python"]
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


def test_links_and_pictures_of_the_description_lead_to_the_repository():
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = (ROOT / "README.md").read_text()
    found = module.with_addresses(text, "https://host/owner/name", "v1.0.0")
    targets = re.findall(r"(!?)\[[^\]]*\]\(([^)\s]+)\)", found)
    assert len(targets) == len(re.findall(r"\]\(", text)) > 20
    for picture, target in targets:
        way = "raw" if picture else "blob"
        assert target.startswith(f"https://host/owner/name/{way}/v1.0.0/")
        assert (ROOT / target.partition("/v1.0.0/")[2]).is_file()
    assert re.sub(r"https://host/owner/name/(raw|blob)/v1.0.0/", "", found) == text


def test_the_release_builds_a_wheel_for_each_python():
    yaml = pytest.importorskip("yaml")
    jobs = yaml.safe_load((ROOT / ".github/workflows/release.yml").read_text())["jobs"]
    named = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", line)]
    assert jobs["wheel"]["strategy"]["matrix"]["python"] == named
    (make,) = [step["run"] for step in jobs["wheel"]["steps"] if "package-check" in step.get("run", "")]
    assert all((ROOT / folder).is_dir() for folder in re.findall(r"tests/\w+", make))
