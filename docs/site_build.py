"""Hooks of mkdocs: formulas become MathML, pictures open charts and replays, and no page refers to other hosts."""

import gzip
import html
import json
import os
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.pages import Page
from mkdocs.utils import get_relative_url

FORMULA = re.compile(r'<(span|div) class="arithmatex">(.*?)</\1>', re.S)
ROOT = Path(__file__).resolve().parents[1]
# what the replays of the gallery and of the first page show; written by benchmarks/gallery.py
REPLAYS = ROOT / "docs/replays"
CARD = re.compile(r'<img [^>]*src="gallery/(\w+)\.webp"[^>]*>')
VERSION = "@VERSION@"
CHART = re.compile(r'<img [^>]*src="([^"]+\.png)"[^>]*>')
# the script that mkdocs-material would fetch, and the one of docs/ that replaces it
FETCHED, OWN = "https://unpkg.com/iframe-worker/shim", "file_search.js"
# by this mark a script of mkdocs-material finds the link to the repository, and asks its host for numbers
ASKING = ' data-md-component="source"'


def on_config(config: MkDocsConfig, **_: object) -> None:
    """Link the repository that MBVI_REPOSITORY or pyproject.toml names, if any."""
    address = os.environ.get("MBVI_REPOSITORY") or _project().get("urls", {}).get("Repository", "")
    if address:
        config.repo_url = address.rstrip("/")
        config.repo_name = config.repo_url.partition("://")[2].partition("/")[2] or config.repo_url


def on_page_content(content: str, **_: object) -> str:
    """Return the page with formulas as MathML, which browsers draw without scripts, and links from its pictures."""
    content = CARD.sub(_card, FORMULA.sub(_formula, content)).replace(VERSION, _project()["version"])
    return CHART.sub(r'<a href="\1">\g<0></a>', content)


def on_post_build(config: MkDocsConfig, **_: object) -> None:
    """Write the pages of the replays, which share one viewer."""
    # mkdocs runs this file where the package need not be installed
    sys.path.insert(0, str(ROOT))
    from mbvi.results.replay.page import viewer_script, written

    folder = Path(config.site_dir, "replays")
    folder.mkdir(exist_ok=True)
    (folder / "viewer.js").write_text(viewer_script(), encoding="utf-8")
    for kept in REPLAYS.glob("*.json.gz"):
        content = json.loads(gzip.decompress(kept.read_bytes()))
        page = written(content, viewer="viewer.js")
        (folder / kept.name.replace(".json.gz", ".html")).write_text(page, encoding="utf-8")


def on_post_page(output: str, page: Page, **_: object) -> str:
    """Return the page with the script of the search from the site itself, and no script that asks other hosts."""
    return output.replace(FETCHED, get_relative_url(OWN, page.url)).replace(ASKING, "")


def on_post_template(output: str, **_: object) -> str:
    """Return a page that is none of docs/, such as 404.html, in the same way."""
    return output.replace(FETCHED, f"/{OWN}").replace(ASKING, "")


def _project() -> dict[str, Any]:
    project: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return project


def _card(found: re.Match[str]) -> str:
    """Return a picture of the gallery, which opens its replay if there is one."""
    picture, name = found[0], found[1]
    if not (REPLAYS / f"{name}.json.gz").exists():
        return picture
    return f'<a class="replay" href="replays/{name}.html#looping" title="play">{picture}</a>'


def _formula(found: re.Match[str]) -> str:
    tag, text = found[1], html.unescape(found[2]).strip()
    # between \( and \), or \[ and \]
    display = "block" if tag == "div" else "inline"
    # a bare bar would be an operator, with spaces around it
    tex = text[2:-2].strip().replace("|", r"\vert ")
    return f'<{tag} class="formula">{convert(tex, display=display)}</{tag}>'
