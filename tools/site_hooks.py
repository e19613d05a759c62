"""What MkDocs calls: texts from their places, parts written from the code, equations as MathML."""

import html
import logging
import re
from pathlib import Path

import latex2mathml.converter
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from site_pages import Site, slug
from site_reference import PARTS, schema

ROOT = Path(__file__).resolve().parents[1]
GENERATED = re.compile(r"^<!-- generated: (\w+) -->$", re.MULTILINE)
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
_log = logging.getLogger("mkdocs.hooks.site")
_texts: dict[str, str] = {}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Give headings the anchors that they have on GitHub, so that links hold on both."""
    config.mdx_configs.setdefault("toc", {})["slugify"] = _slugify
    return config


def _slugify(text: str, separator: str) -> str:
    return slug(html.unescape(text))


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Put every page together, and add pictures and the schema of the records."""
    authored = {page.src_uri: page.content_string for page in files.documentation_pages()}
    pages = {name: GENERATED.sub(_generated, text) for name, text in authored.items()}
    site = Site(ROOT, pages, _log.warning)
    _texts.clear()
    for page in pages:
        _texts[page] = site.markdown(page)
    for name, source in site.pictures.items():
        files.append(File.generated(config, name, content=(ROOT / source).read_bytes()))
    files.append(File.generated(config, "reference/records.schema.json", content=schema()))
    return files


def _generated(match: re.Match[str]) -> str:
    if match[1] not in PARTS:
        _log.warning("there is no generated part '%s'", match[1])
        return ""
    return PARTS[match[1]]()


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return the text that `on_files` put together."""
    return _texts.get(page.file.src_uri, markdown)


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    r"""Turn \(…\) and \[…\] into MathML, which browsers draw without a script."""
    return EQUATION.sub(_mathml, content)


def _mathml(match: re.Match[str]) -> str:
    display = "block" if match[1] == "div" else "inline"
    equation: str = latex2mathml.converter.convert(html.unescape(match[2]).strip(), display=display)
    return f"<div class='equation'>{equation}</div>" if display == "block" else equation
