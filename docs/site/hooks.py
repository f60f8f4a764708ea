"""Makes a site of the documents: pages that are made from the code, and links that work beyond docs/.

The documents link to files of the repository, as `../specs/battery_uav.yaml`. Those files come along, under
`repository/`: Markdown as pages of the site, all else as it is, to be read as text. A folder's link leads to its
README; one without is no link.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import reference
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"(\[(?:[^\[\]]|\[[^\[\]]*\])*\])\(([^)\s#:]+)(#[^)\s]*)?\)")
ROW = re.compile(r"^\|.*$", re.MULTILINE)
FENCE = re.compile(r"(^ *```.*?^ *```$)", re.DOTALL | re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """Add the pages that are made, and the files of the repository that pages link to."""
    for name, page in reference.pages(ROOT).items():
        files.append(File.generated(config, name, content=page))
    waiting = [ROOT / "docs" / file.src_uri for file in files.documentation_pages() if file.generated_by is None]
    waiting += [ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("examples/*/README.md")]
    seen: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        if not path.is_relative_to(ROOT / "docs"):
            files.append(File.generated(config, place_of(path), abs_src_path=str(path)))
        if path.suffix == ".md":
            waiting += (target for target in targets(path) if target.is_file())
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead the links of a page to where their files are on the site."""
    if page.file.generated_by is not None and page.file.abs_src_path is None:
        return markdown
    source = Path(page.file.abs_src_path)

    def placed(match: re.Match[str]) -> str:
        target = target_of(source, match[2])
        if target is None:
            return match[0]
        if not target.is_file():
            return match[1][1:-1]
        place = posixpath.relpath(place_of(target), posixpath.dirname(page.file.src_uri))
        return f"{match[1]}({place}{match[3] or ''})"

    parts = FENCE.split(markdown)
    return "".join(part if FENCE.match(part) else ROW.sub(unescaped, LINK.sub(placed, part)) for part in parts)


def unescaped(row: re.Match[str]) -> str:
    """A table's row with its code as it is meant: GitHub wants a backslash before a bar, which is shown here."""
    return re.sub("`[^`]*`", lambda code: code[0].replace("\\|", "|"), row[0])


def targets(path: Path) -> Iterable[Path]:
    """The files and folders of the repository that a document links to."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    return [target for match in LINK.finditer(text) if (target := target_of(path, match[2])) is not None]


def target_of(source: Path, link: str) -> Path | None:
    """What a link of a document leads to, of a folder its README; none where that is not a part of the repository."""
    path = (source.parent / link).resolve()
    if not path.exists() or not path.is_relative_to(ROOT):
        return None
    readme = path / "README.md"
    return readme if readme.is_file() else path


def place_of(path: Path) -> str:
    """Where a file of the repository is on the site, by the name of its source."""
    if path.is_relative_to(ROOT / "docs"):
        return path.relative_to(ROOT / "docs").as_posix()
    name = path.relative_to(ROOT).as_posix()
    return f"repository/{name}" if path.suffix in {".md", ".png"} else f"repository/{name}.txt"
