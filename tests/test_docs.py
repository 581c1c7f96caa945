"""The site of the docs: every page is listed, every public name documented, and nothing fetched from elsewhere."""

import html
import json
import os
import re
import subprocess
import sys

import pytest

import mbvi
from mbvi.results.replay.browser import Browser, page_address
from support.browser import needs_browser
from support.paths import DOCS, EXAMPLES, ROOT


def test_every_public_name_has_an_entry_of_the_reference():
    entries = re.findall(r"^::: (\S+)$", "\n".join(page.read_text() for page in DOCS.rglob("*.md")), re.M)
    assert sorted(entries) == sorted(set(entries))
    assert {name for name in entries if name.count(".") == 1} == {f"mbvi.{name}" for name in mbvi.__all__}


def test_every_page_is_listed_once():
    listed = re.findall(r"^ +- (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M)
    assert sorted(listed) == sorted(page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md"))


def test_pages_refer_to_no_other_host_and_hold_no_second_copy_of_a_table():
    texts = [page.read_text() for page in DOCS.rglob("*.md")]
    assert not [found for text in texts for found in re.findall(r"!\[[^\]]*\]\(https?:[^)]*\)", text)]
    # rows with numbers stand in one place only
    rows = [row for text in texts for row in set(re.findall(r"^\|.*\d.*\|.{40,}\|$", text, re.M))]
    assert len(rows) == len(set(rows))


def test_every_example_is_in_the_gallery():
    gallery = (DOCS / "gallery.md").read_text()
    assert [file.stem for file in EXAMPLES.glob("*.py") if f"`examples/{file.name}`" not in gallery
            and f'"examples/{file.name}"' not in gallery] == []  # fmt: skip


def test_pictures_are_small():
    """Those of the gallery are at most 1.5 MB together."""
    assert sum(file.stat().st_size for file in (DOCS / "gallery").iterdir()) < 1.5e6


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Build the site; mkdocs is strict, so that a link without a target is an error."""
    pytest.importorskip("mkdocs")
    folder = tmp_path_factory.mktemp("site")
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.slow(seconds=12)
def test_the_site_is_built_with_all_names_formulas_and_a_search_of_its_own(site):
    pages = {page.relative_to(site).as_posix(): page.read_text() for page in site.rglob("*.html")}
    anchors = set(re.findall(r'id="(mbvi\.[\w.]+)"', "".join(pages.values())))
    assert {f"mbvi.{name}" for name in mbvi.__all__} <= anchors
    # methods are documented with their classes
    assert {"mbvi.Scene.add_urdf", "mbvi.Trajectory.diagnosis", "mbvi.motion.Rotation"} <= anchors
    for name, text in pages.items():
        fetched = re.findall(
            r'<(?:script|img|iframe|link rel="stylesheet")[^>]*(?:src|href)="((?:https?:)?//[^"]*)', text
        )
        assert fetched == [], name
        assert "arithmatex" not in text, name
        # no command of TeX is left in a formula
        assert "\\" not in re.sub("<[^>]*>", "", "".join(re.findall("<math.*?</math>", text, re.S))), name
    assert pages["theory/friction.html"].count("<math") > 20
    # the gallery holds the examples themselves
    text = re.sub("<[^>]*>", "", pages["gallery.html"])
    assert [file.stem for file in EXAMPLES.glob("*.py") if f'![{file.stem}]' in (DOCS / "gallery.md").read_text()
            and file.read_text().splitlines()[0].strip('"') not in html.unescape(text)] == []  # fmt: skip
    index = json.loads((site / "search/search_index.json").read_text())
    assert any("percussion" in entry["text"] for entry in index["docs"])


@needs_browser
@pytest.mark.slow(seconds=20)
def test_the_search_finds_a_word_on_pages_that_are_opened_as_files(site):
    with Browser(1200, 900) as browser:
        browser.open(
            page_address(site / "theory/friction.html") + "?q=percussion",
            "/\\d+ matching documents/.test(document.body.innerText)",
        )
        assert not browser.errors
        # formulas are drawn, not printed
        assert browser.evaluate("document.querySelectorAll('article msub').length") > 0
        assert "\\mu" not in browser.evaluate("document.querySelector('article').innerText")
