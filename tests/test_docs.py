"""The site of the docs: every page is listed, every public name documented, and nothing fetched from elsewhere."""

import html
import json
import os
import re
import subprocess
import sys

import pytest

import mbvi
from mbvi.compiled.one_process import one_process
from mbvi.results.replay.browser import Browser, page_address
from support.browser import needs_browser
from support.paths import DOCS, EXAMPLES, ROOT

REPOSITORY = "https://github.com/owner/name"


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
    """Those of the gallery are at most 1.5 MB together, and its replays 2.2 MB."""
    for folder, most in (("gallery", 1.5e6), ("replays", 2.2e6)):
        assert sum(file.stat().st_size for file in (DOCS / folder).iterdir()) < most


def test_every_picture_of_a_run_has_its_replay():
    pictures = {file.stem for file in (DOCS / "gallery").glob("*.webp")}
    assert {file.name.partition(".")[0] for file in (DOCS / "replays").iterdir()} == pictures | {"demo"}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Build the site, once for all processes that run tests; mkdocs is strict: a link without a target is an error."""
    pytest.importorskip("mkdocs")
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    folder, built = shared / "site", shared / "site is built"
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "MBVI_REPOSITORY": REPOSITORY}
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    with one_process(shared, "site"):
        if not built.exists():
            done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
            assert done.returncode == 0, done.stdout + done.stderr
            built.touch()
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


@pytest.mark.slow(seconds=12)
def test_every_page_links_the_repository_and_asks_its_host_for_nothing(site):
    for page in (site / "index.html", site / "howto/robots.html", site / "404.html"):
        text = page.read_text()
        assert set(re.findall(r'href="(https://github[^"]*)"', text)) == {REPOSITORY}, page
        assert 'data-md-component="source"' not in text and "owner/name\n" in text, page


@needs_browser
@pytest.mark.slow(seconds=60)
def test_the_first_page_and_the_gallery_play_replays(site):
    # without a graphics card the time of a frame grows with the window
    with Browser(480, 360) as browser:
        for name in sorted(file.stem for file in (site / "replays").glob("*.html")):
            browser.open(page_address(site / f"replays/{name}.html") + "#looping", "replay.ready && replay.playing")
            assert browser.evaluate("replay.loops && document.title.includes(' by ')"), name
            assert not browser.errors, name
    with Browser(1280, 900) as browser:
        browser.open(page_address(site / "index.html"), "document.readyState === 'complete'")
        # what the replay does leaves the page at its top
        assert browser.evaluate("scrollY") == 0
        assert browser.evaluate("document.querySelector('iframe.demo').src").endswith("replays/demo.html#looping")
        browser.open(page_address(site / "gallery.html"), "document.readyState === 'complete'")
        links = browser.evaluate("[...document.querySelectorAll('a.replay')].map(a => a.getAttribute('href'))")
        assert len(links) == len(list((site / "gallery").glob("*.webp")))
        assert all((site / link.partition("#")[0]).exists() for link in links)


@needs_browser
@pytest.mark.slow(seconds=15)
def test_every_visit_follows_the_colors_of_the_system(site):
    with Browser(1280, 900) as browser:
        for system, scheme in (("dark", "slate"), ("light", "default"), ("dark", "slate")):
            wanted = [{"name": "prefers-color-scheme", "value": system}]
            browser.call("Emulation.setEmulatedMedia", features=wanted)
            browser.open(page_address(site / "howto/robots.html"), "document.readyState === 'complete'")
            assert browser.evaluate("document.body.dataset.mdColorScheme") == scheme
        # while it is open, too
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "light"}])
        browser.wait("document.body.dataset.mdColorScheme === 'default'")


@needs_browser
@pytest.mark.slow(seconds=60)
@pytest.mark.parametrize("width", [390, 1280])
def test_no_page_is_wider_than_its_window_and_no_code_is_cut_on_a_screen(site, width):
    with Browser(width, 900) as browser:
        for page in sorted(site.rglob("*.html")):
            if page.parent.name == "replays":
                continue
            browser.open(page_address(page), "document.readyState === 'complete'")
            assert browser.evaluate("document.documentElement.scrollWidth <= innerWidth"), page
            code = "[...document.querySelectorAll('pre > code')].filter(c => c.offsetParent)"
            assert width < 1280 or browser.evaluate(f"{code}.every(c => c.scrollWidth <= c.clientWidth)"), page


@needs_browser
@pytest.mark.slow(seconds=20)
@pytest.mark.parametrize(
    ("words", "method"),
    [("restitution pair", "set_restitution"), ("friction pair", "set_friction"), ("contact force", "contact_forces")],
)
def test_the_search_finds_methods_first(site, words, method):
    with Browser(1200, 900) as browser:
        address = page_address(site / "index.html") + f"?q={words.replace(' ', '%20')}"
        browser.open(address, "document.querySelectorAll('.md-search-result__item h2').length > 2")
        assert browser.evaluate("document.querySelector('.md-search-result__item h2').innerText") == method


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
