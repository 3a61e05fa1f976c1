"""Makes the repository's pages one site: what MkDocs calls while it builds (`make docs`).

MkDocs knows the files of one folder only, but pages also link to files elsewhere in the repository,
as a reader of the checkout needs them. Each of these becomes a part of the site, and the links lead
there; pages that are linked bring what they link to. A notebook becomes a page too.
"""

import json
import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
_LINK = re.compile(r"(?<=\]\()(?P<path>[^)\s:#]+)(?P<anchor>#[^)\s]*)?(?=\))")
"""The target of a link or picture that is a file, in Markdown."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds every file that a page links to, directly or through other pages, and the notebooks."""
    pages = [Path(file.abs_src_path or "") for file in files.documentation_pages()]
    for file in [*files]:
        if file.src_uri.endswith(".ipynb"):
            content = _as_page(Path(file.abs_src_path or ""))
            files.append(File.generated(config, _page_of(file.src_uri), content=content))
    for page in pages:
        for link in _LINK.finditer(page.read_text(encoding="utf-8")):
            linked = (page.parent / link["path"]).resolve()
            place = _place(linked)
            if linked.is_file() and not files.get_file_from_path(place):
                files.append(File.generated(config, place, abs_src_path=str(linked)))
                if linked.suffix == ".md":
                    pages.append(linked)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Returns the page with links to where the files are in the site."""
    here = Path(page.file.abs_src_path or ROOT / "docs" / page.file.src_uri)
    there = posixpath.dirname(page.file.src_uri)

    def moved(link: re.Match[str]) -> str:
        place = _place((here.parent / link["path"]).resolve())
        if _page_of(place) != page.file.src_uri:
            place = _page_of(place)
        return posixpath.relpath(place, there or ".") + (link["anchor"] or "")

    return _LINK.sub(moved, markdown)


def _page_of(place: str) -> str:
    """Returns the page that stands for a notebook; any other place is its own."""
    return re.sub(r"\.ipynb$", ".md", place)


def _as_page(notebook: Path) -> str:
    """Returns a notebook in Markdown, with its title first and a link to itself."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    texts = [
        text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"
        for cell in cells
        for text in ["".join(cell["source"])]
    ]
    title, _, rest = texts[0].partition("\n")
    return "\n\n".join((title, f"[Download this notebook]({notebook.name})", rest, *texts[1:]))


def _place(file: Path) -> str:
    """Returns where a file of the repository is in the site: that of docs at its top."""
    return file.relative_to(ROOT).as_posix().removeprefix("docs/")
