"""What a page of the site takes of the repository's texts, and where its links lead then."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from site_pages import Section, Site, lists_apart, sections, slug

GUIDE = """# Guide

Intro, see [below](#b-part) and [live.md](live.md#gate).

## A `x`

text [code](../tools/x.py) ![curve](curve.png)

```sh
# no heading
[not](a/link.md)
```

### Deep

deep

## B: part

last [deep](#deep)
"""
LIVE = "# Live\n\n## Gate\n\n[guide](guide.md), [other](other.md), [no](guide.md#nowhere), [far](https://x.example/a)\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "host").mkdir()
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools/x.py").touch()
    (tmp_path / "host/curve.png").touch()
    (tmp_path / "host/guide.md").write_text(GUIDE)
    (tmp_path / "host/live.md").write_text(LIVE)
    return tmp_path


def build(root: Path, said: list[str] | None = None, **pages: str) -> Site:
    named = {name.replace("__", "/") + ".md": text for name, text in pages.items()}
    return Site(root, named, (said if said is not None else []).append)


def test_a_section_goes_where_it_is_asked_for_and_links_follow_it(root: Path) -> None:
    said: list[str] = []
    site = build(
        root,
        said,
        index="# Home\n\n<!-- include: host/guide.md#a-x -->\n",
        more__rest="# Rest\n\n<!-- include: host/guide.md rest -->\n",
        more__live="# Fit\n\n<!-- include: host/live.md#gate body -->\n",
    )
    home = site.markdown("index.md")
    assert "text code ![curve](pictures/curve.png)" in home
    assert "# no heading\n[not](a/link.md)" in home
    assert "### Deep" in home
    assert site.pictures == {"pictures/curve.png": "host/curve.png"}
    rest = site.markdown("more/rest.md")
    assert "## B: part" in rest
    assert "[deep](../index.md#deep)" in rest
    assert "## A" not in rest
    live = site.markdown("more/live.md")
    assert "## Gate" not in live
    assert "[guide](../index.md), other, no, [far](https://x.example/a)" in live
    assert said == [
        "host/live.md: links to other.md, which is not there",
        "host/live.md: links to guide.md#nowhere, but host/guide.md has no such heading",
    ]


def test_the_whole_text_its_introduction_and_all_but_a_part(root: Path) -> None:
    site = build(
        root,
        whole="# W\n\n<!-- include: host/guide.md -->\n",
        intro="# I\n\n<!-- include: host/guide.md#guide intro -->\n",
        part="# P\n\n<!-- include: host/guide.md#a-x body without=deep -->\n",
        live="# The fit\n\n<!-- include: host/live.md -->\n",
    )
    whole = site.markdown("whole.md")
    assert whole.count("\n## ") == 2
    assert "# Guide" not in whole
    assert "[below](whole.md#b-part) and [The fit](live.md#gate)" in whole
    assert "Intro" in site.markdown("intro.md")
    assert "## A" not in site.markdown("intro.md")
    assert "text" in site.markdown("part.md")
    assert "deep" not in site.markdown("part.md")


def test_what_is_not_there_is_told_unless_it_is_optional(root: Path) -> None:
    said: list[str] = []
    site = build(
        root,
        said,
        a="<!-- include: host/guide.md#gone -->",
        b="<!-- include: host/none.md -->",
        c="x\n<!-- include: host/guide.md#gone body optional -->\ny",
    )
    assert said == ["a.md: host/guide.md has no section #gone", "b.md: there is no host/none.md"]
    assert site.markdown("a.md") == ""
    assert site.markdown("c.md") == "x\n\ny"


@pytest.mark.parametrize(
    ("heading", "anchor"),
    [
        ("What α and f are worth", "what-α-and-f-are-worth"),
        ("`hello`", "hello"),
        ("A Dask cluster, and whom it trusts", "a-dask-cluster-and-whom-it-trusts"),
        ("fltea identify: α and f", "fltea-identify-α-and-f"),
    ],
)
def test_anchors_are_those_of_github(heading: str, anchor: str) -> None:
    assert slug(heading) == anchor


@given(st.lists(st.sampled_from(["# A", "## B", "### C", "```", "x", "", "#no", "- y", "~~~"])))
def test_nothing_of_a_text_is_lost_when_it_is_taken_apart(lines: list[str]) -> None:
    text = "".join(line + "\n" for line in lines)
    assert "".join(one.text(0) for one in sections(text)) == text


def test_levels_end_at_the_first() -> None:
    assert Section(3, "x", "").text(1) == "## x\n"
    assert Section(2, "x", "").text(5) == "# x\n"


def test_lists_are_written_as_markdown_wants_them() -> None:
    text = "words:\n- one\n  goes on\n  - below\n\n```\nx:\n- y\n```\n"
    assert lists_apart(text) == "words:\n\n- one\n  goes on\n    - below\n\n```\nx:\n- y\n```\n"
