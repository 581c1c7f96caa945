"""The pages: blocks of Python run and print what follows them; links, paths and names that pages mention exist."""

import contextlib
import io
import pkgutil
import re

import pytest

import mbvi
from support.paths import ROOT

BLOCK = re.compile(r"^```python\n(?P<code>.*?)^```\n(?:\nprints\n\n```\n(?P<printed>.*?)^```\n)?", re.M | re.S)
DOCS_PAGES = sorted((ROOT / "docs").rglob("*.md"))
# the blocks of a tutorial are typed into one session; each other block stands alone
TUTORIALS = [path for path in DOCS_PAGES if path.parent.name == "tutorials"]
BLOCKS = [
    pytest.param(found, id=f"{path.relative_to(ROOT).as_posix()}-{k}")
    for path in (ROOT / "README.md", *DOCS_PAGES)
    if path not in TUTORIALS
    for k, found in enumerate(BLOCK.finditer(path.read_text()))
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in an empty folder: mbvi brings the robots."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def check(found, names):
    """Run a block with these names, and compare what it prints with what the page says."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(found["code"], "block", "exec"), names)
    assert printed.getvalue() == (found["printed"] or "")


@pytest.mark.usefixtures("sweeps_in_a_thread")
@pytest.mark.parametrize("found", BLOCKS)
def test_a_block_runs_and_prints_what_follows(found, folder):
    check(found, {"__name__": "__main__"})
    if "replay_html" in found["code"]:
        assert next(folder.glob("*.html")).stat().st_size > 500_000


@pytest.mark.usefixtures("sweeps_in_a_thread")
@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.name)
def test_the_blocks_of_a_tutorial_run_one_after_the_other(path, folder):
    names = {"__name__": "__main__"}
    blocks = list(BLOCK.finditer(path.read_text()))
    assert len(blocks) >= 3
    for found in blocks:
        check(found, names)


def test_blocks_are_found():
    pages = [path for path in (ROOT / "README.md", *DOCS_PAGES) if path not in TUTORIALS]
    assert len(BLOCKS) == sum(page.read_text().count("```python") for page in pages) > 15
    # whatever prints says what
    assert all(p.values[0]["printed"] for p in BLOCKS if "print(" in p.values[0]["code"])


def test_the_readme_is_read_in_a_few_minutes():
    """600 to 800 words; everything else is a page of the site."""
    assert 600 <= len((ROOT / "README.md").read_text().split()) <= 800


PAGES = [
    pytest.param(path, id=path.relative_to(ROOT).as_posix())
    for path in (
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md") if (ROOT / name).exists()),
        *DOCS_PAGES,
        *sorted((ROOT / "robots").glob("*/README.md")),
    )
]
FOLDERS = ("mbvi", "mbvi_studies", "tests", "docs", "examples", "benchmarks", "robots", "tools")


def anchors(page):
    """Return the names by which GitHub and the site link to the headings of a page."""
    # a page may include a file of the root
    text = re.sub(r'^--8<-- "(.+)"$', lambda found: (ROOT / found[1]).read_text(), page.read_text(), flags=re.M)
    headings = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES)
def test_every_relative_link_leads_to_a_file_and_a_heading(page):
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path) if path else page
        if not file.exists() or (anchor and anchor not in anchors(file)):
            broken.append(target)
    assert broken == []


@pytest.mark.parametrize("page", PAGES)
def test_every_path_that_a_page_names_exists(page):
    # targets of links are relative to their page, and checked above
    text = re.sub(r"\]\([^)\s]+\)", "]", page.read_text())
    named = re.findall(rf"(?<![\w/.-])((?:{'|'.join(FOLDERS)})/[\w./-]*\w\.\w+)", text)
    assert [path for path in named if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("page", PAGES)
def test_every_module_and_function_that_a_page_names_exists(page):
    for name in sorted(set(re.findall(r"`(mbvi(?:\.\w+)+)[`(]", page.read_text()))):
        assert pkgutil.resolve_name(name) is not None, name


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
