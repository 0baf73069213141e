"""The documentation site: ``sphinx-build -W --keep-going -n docs build/site``."""

import enum
import importlib.metadata
import importlib.util
import pathlib
import re
import shutil
import subprocess
import sys
import warnings

from numpydoc.docscrape import NumpyDocString
from numpydoc.docscrape_sphinx import SphinxDocString

from hereditary import Status

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import made_pages

project = "hereditary"
copyright = "the hereditary authors"
release = version = importlib.metadata.version("hereditary")

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx_gallery.gen_gallery",
]
templates_path = ["_templates"]
exclude_patterns = [
    "_templates",
    "gallery/**",
    "joss/**",
    "made/gallery/**/*.ipynb",
    "made/gallery/**/*.py",
    "made/scripts/**",
]
suppress_warnings = ["config.cache"]  # the gallery's settings hold functions

myst_enable_extensions = ["dollarmath", "attrs_inline"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings say more
default_role = "autolink"
maximum_signature_line_length = 88
numpydoc_show_class_members = False

# -n: names in single backquotes that autolink finds, but that have no page
nitpick_ignore_regex = [
    ("py:obj", r"scipy\..*"),
    ("py:obj", r"hereditary\.kernels"),
    ("py:obj", r"components|corrections|d|equation|linear|m|orders|params|tol|trace"),
]

# MathJax 3.2.2 from the package sphinx-mathjax-offline: two of its many files, 1.5 MB of 24
mathjax_path = "mathjax/tex-chtml.js"
mathjax3_config = {
    "tex": {"packages": {"[-]": ["noundefined"]}},  # a misspelt command is an error, not red text
    "options": {"enableMenu": False},
}

html_theme = "furo"
html_title = f"hereditary {release}"
html_static_path = ["_static"]
html_css_files = ["gallery.css"]
html_favicon = "_static/favicon.svg"
html_show_sourcelink = False
html_copy_source = False

# each example is run when it has changed, and ends the build where it fails
sphinx_gallery_conf = {
    "examples_dirs": "made/scripts",  # copies, beside which examples may write files
    "gallery_dirs": "made/gallery",
    "filename_pattern": r"/[a-z_]+\.py$",
    "abort_on_example_error": True,
    "remove_config_comments": True,
    "thumbnail_size": (600, 420),  # in pixels, twice as wide as they are shown
    "capture_repr": (),
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "within_subsection_order": "made_pages.by_interest",
    "image_scrapers": ("matplotlib",),
    "reset_modules": ("matplotlib", "made_pages.styled"),
}
warnings.filterwarnings("ignore", message="FigureCanvasAgg is non-interactive")

# numpydoc drops sections that it does not know: let the library's own follow the notes
_OWN = ("Error", "Stability", "Cost", "Source")
_section = SphinxDocString._str_section


def _with_own_sections(self, name):
    names = (name, *_OWN) if name == "Notes" else (name,)
    return [line for each in names for line in _section(self, each)]


NumpyDocString.sections.update(dict.fromkeys(_OWN, ()))
SphinxDocString._str_section = _with_own_sections


def _copy_mathjax(app, failure):
    if failure is None and app.builder.format == "html":
        package = importlib.util.find_spec("sphinx-mathjax-offline").submodule_search_locations[0]
        source = pathlib.Path(package, "static", "mathjax")
        target = pathlib.Path(app.outdir, "_static", "mathjax")
        fonts = "output/chtml/fonts/woff-v2"
        shutil.copytree(source / fonts, target / fonts, dirs_exist_ok=True)
        shutil.copy(source / "tex-chtml.js", target)


# What steppers ask of schemes, histories and equations, and no user: docs/extending.md has it.
_INNER = {"plan", "mesh_plan", "memory", "coarse", "current", "parts", "constant"}


def _skip(app, what, name, obj, skip, options):
    """Show members of enumerations, which lack docstrings; hide inner members and idle ones."""
    if isinstance(obj, enum.Enum):
        return isinstance(obj, Status)
    idle = (getattr(obj, "__doc__", "") or "").startswith("Alias for field")
    return True if idle or name in _INNER else None


_KEY = r"(?<![\[\w])\[([A-Z]\w+\d{4}|ParovikStickSlip)\](?![(_:\]])"


def _link_keys(app, page, source):
    """Link citation keys of pages to their entries in the list of literature."""
    if page == "literature":
        source[0] = re.sub(r"\*\*\[(\w+)\]\*\*", r"[**\[\1\]**]{#\1}", source[0])
    elif str(app.env.doc2path(page)).endswith(".md"):
        source[0] = re.sub(_KEY, r"[\[\1\]](#\1)", source[0])


def _link(app, what, name, obj, options, lines):
    """Link citation keys, pages and studies in docstrings; list statuses with their sentences."""
    if obj is Status:
        lines += ["", *(f"- ``{each}``: {each.sentence}" for each in Status), ""]
    text = re.sub(_KEY, r":ref:`[\1] <\1>`", "\n".join(lines))
    text = re.sub(r"\bdocs/(\w+)\.md", r":doc:`/\1`", text)
    text = re.sub(r"\bconvergence/(\w+)\.py", r":doc:`\g<0> </made/studies/\1>`", text)
    lines[:] = text.split("\n")


def setup(app):
    """Make the pages that are not written by hand, before any is read, and compile for these."""
    subprocess.run([sys.executable, "-m", "hereditary", "compile"], check=True)
    made_pages.make(pathlib.Path(__file__).parent)
    app.connect("autodoc-skip-member", _skip)
    app.connect("autodoc-process-docstring", _link, priority=900)
    app.connect("source-read", _link_keys)
    app.connect("build-finished", _copy_mathjax)
