"""Hooks of mkdocs: formulas become MathML, charts open in full size, and no page refers to other hosts."""

import html
import re

from latex2mathml.converter import convert
from mkdocs.structure.pages import Page
from mkdocs.utils import get_relative_url

FORMULA = re.compile(r'<(span|div) class="arithmatex">(.*?)</\1>', re.S)
CHART = re.compile(r'<img [^>]*src="([^"]+\.png)"[^>]*>')
# the script that mkdocs-material would fetch, and the one of docs/ that replaces it
FETCHED, OWN = "https://unpkg.com/iframe-worker/shim", "file_search.js"


def on_page_content(content: str, **_: object) -> str:
    """Return the page with each formula as MathML, which browsers draw without scripts, and links to its charts."""
    return CHART.sub(r'<a href="\1">\g<0></a>', FORMULA.sub(_formula, content))


def on_post_page(output: str, page: Page, **_: object) -> str:
    """Return the page with the script of the search from the site itself."""
    return output.replace(FETCHED, get_relative_url(OWN, page.url))


def on_post_template(output: str, **_: object) -> str:
    """Return a page that is none of docs/, such as 404.html, in the same way."""
    return output.replace(FETCHED, f"/{OWN}")


def _formula(found: re.Match[str]) -> str:
    tag, text = found[1], html.unescape(found[2]).strip()
    # between \( and \), or \[ and \]
    display = "block" if tag == "div" else "inline"
    # a bare bar would be an operator, with spaces around it
    tex = text[2:-2].strip().replace("|", r"\vert ")
    return f'<{tag} class="formula">{convert(tex, display=display)}</{tag}>'
