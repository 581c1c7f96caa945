"""Every block of Python in the README and in docs/ runs as it stands, and prints what follows it."""

import contextlib
import io
import re

import pytest

import mbvi
from support.paths import ROOT

BLOCK = re.compile(r"^```python\n(?P<code>.*?)^```\n(?:\nprints\n\n```\n(?P<printed>.*?)^```\n)?", re.M | re.S)
BLOCKS = [
    pytest.param(found, id=f"{path.name}-{k}")
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    for k, found in enumerate(BLOCK.finditer(path.read_text()))
]


@pytest.mark.parametrize("found", BLOCKS)
def test_a_block_runs_and_prints_what_follows(found, tmp_path, monkeypatch):
    (tmp_path / "robots").symlink_to(ROOT / "robots")
    monkeypatch.chdir(tmp_path)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(found["code"], "block", "exec"), {"__name__": "__main__"})
    assert printed.getvalue() == (found["printed"] or "")
    if "replay_html" in found["code"]:
        assert next(tmp_path.glob("*.html")).stat().st_size > 500_000


def test_blocks_are_found():
    counts = {page: (ROOT / page).read_text().count("```python") for page in ("README.md", "docs/guide.md")}
    assert {page: sum(p.id.startswith(page.rpartition("/")[2]) for p in BLOCKS) for page in counts} == counts
    assert counts["README.md"] >= 1 and counts["docs/guide.md"] >= 5
    # whatever prints says what
    assert all(p.values[0]["printed"] for p in BLOCKS if "print(" in p.values[0]["code"])


def test_the_files_that_contributing_names_exist():
    """Paths with a folder, the files of the root, and the commands of make."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    named = set(re.findall(r"`([\w.-]+(?:/[\w.-]*)+|[A-Z]+\.\w+|pyproject\.toml)`", text))
    assert len(named) > 20
    assert not [path for path in named if not (ROOT / path).exists()]
    goals = re.findall(r"^make ([\w-]+)", text, re.M)
    makefile = (ROOT / "Makefile").read_text()
    assert goals and all(f"\n{goal}: " in makefile for goal in goals)


def test_versions_are_one_version():
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.M)[1]
    project = re.search(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(), re.M)[1]
    assert cited == project == mbvi.__version__
