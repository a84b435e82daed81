"""The book: README, the pages of docs/ and the reference of the Python package, by Sphinx.

    sphinx-build -c docs -W . OUT       from the root of the sources; tests/book/book.sh does it for the test

The pages are plain Markdown that a Git host shows as well. So the root of the sources is the source folder, links are
relative, and the tables of contents are made from the lists of links in docs/index.md. The long tables of the measurements, the
appendices of pages, are only here: scripts/tables_of_pages.py makes them from bench/results.
"""
import os
import re
import sys

sys.path.insert(0, os.environ.get("BROMWICH_PYTHON_PACKAGE", ""))
sys.path.insert(1, os.path.join(os.path.dirname(__file__), os.pardir, "scripts"))
from tables_of_pages import with_appendix  # noqa: E402

project = "bromwich"
author = copyright = "bromwich developers"
root_doc = "docs/index"
include_patterns = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "examples/README.md", "docs/**.md"]
exclude_patterns = ["build*", "out", ".*", "**/.*"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
source_suffix = {".md": "markdown"}
myst_heading_anchors = 4
# A file that is no page, such as a scene, is offered for download.
nitpicky = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"members": True, "undoc-members": False, "show-inheritance": True}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
copybutton_exclude = ".linenos, .gp, .go"

html_theme = "furo"
html_title = "bromwich"
html_static_path = ["static"]
html_css_files = ["book.css"]
html_copy_source = False
html_show_sphinx = False

LINK = re.compile(r"^\|? ?[-*]? ?\[([^\]]+)\]\(([^)#]+\.md)(#[^)]*)?\)", re.M)


def contents(text):
    """The hidden table of contents below each heading of docs/index.md that is followed by links."""
    parts = re.split(r"(?m)^(## .*)$", text)
    out = [parts[0]]
    for heading, body in zip(parts[1::2], parts[2::2]):
        pages = [f"{link[0]} <{link[1].removesuffix('.md')}>" for link in LINK.findall(body)]
        out += [heading, body]
        if pages:
            tree = "\n".join(pages)
            out.append(f"\n```{{toctree}}\n:hidden:\n:caption: {heading[3:]}\n\n{tree}\n```\n\n")
    return "".join(out)


def folder_links(app, name, text):
    """Links to folders of the sources, which a Git host shows and a book has not, become their names."""
    where = os.path.join(app.srcdir, os.path.dirname(name))

    def plain(match):
        target = match[2].split("#")[0]
        return match[1] if target and os.path.isdir(os.path.join(where, target)) else match[0]

    return re.sub(r"(?<!!)\[([^\]]+)\]\(([^):]+)\)", plain, text)


def read(app, name, source):
    text = folder_links(app, name, with_appendix(f"{name}.md", source[0]))
    if name == "docs/cpp":  # what Doxygen makes lies beside the pages
        text = text.replace("`cpp/index.html`", '<a href="../cpp/index.html">cpp/index.html</a>')
    source[0] = contents(text) if name == root_doc else text


def bars(app, what, name, obj, options, lines):
    """|y| in a docstring is an absolute value and no substitution."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def setup(app):
    app.connect("autodoc-process-docstring", bars)
    app.connect("source-read", read)
