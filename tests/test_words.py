"""Pages and docstrings: no sentence above 25 words, and none of the terms that were ours alone."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("docs/joss/*.md")]
ROOMS = "src", "docs/gallery", "convergence"
CODE = [path for room in ROOMS for path in ROOT.glob(f"{room}/**/*.py")]
TERMS = re.compile(r"\b(told|begun|stretch(es)?|paces?)\b|\bsome \d", re.IGNORECASE)
# In this order: code, output and displayed math, directives, tables, headings, types, spans, links.
NO_PROSE = (
    r"(?ms)^---\n.*?^---$|^ *(```|\$\$).*?^ *\1$",
    r"(?m)^ *>>> .*(\n.*\S.*)*|^( *)\.\. .*(\n+\2 +\S.*)*|^ *=+ =[= ]*\n(.*\S.*\n)+",
    r"(?m)^ *(\||#|!\[|<!--).*|^.*\n *-{3,}$|^ *[\w*][\w*, `]* : .*",
    r"(:\w+:)?`+[^`]+`+|\$[^$]+\$|\]\([^)]*\)",
)
ENDS = re.compile(r"(?<=[.?!])[)*\"_]*\s+(?=[^a-z])|\n\s*\n|^ *(?:[-*]|\d+\.) ", re.MULTILINE)
# Words of a sentence, as CONTRIBUTING.md has it.
LONGEST = 25
EXCEPTIONS = ()


def sentences(path):
    """Yield the sentences of a page, or those of the docstrings of a script."""
    texts = [path.read_text()]
    if path.suffix == ".py":
        kinds = ast.Module | ast.ClassDef | ast.FunctionDef
        nodes = [node for node in ast.walk(ast.parse(texts[0])) if isinstance(node, kinds)]
        texts = [ast.get_docstring(node) or "" for node in nodes]
    for text in texts:
        for pattern, left in zip(NO_PROSE, ("\n\n", "\n\n", "\n\n", "X"), strict=True):
            text = re.sub(pattern, left, text)
        yield from (" ".join(part.split()) for part in ENDS.split(text))


@pytest.mark.parametrize("path", PAGES + CODE, ids=lambda path: str(path.relative_to(ROOT)))
def test_sentences_are_short_and_terms_are_known(path):
    hard = [each for each in sentences(path) if len(each.split()) > LONGEST or TERMS.search(each)]
    assert not set(hard) - set(EXCEPTIONS)


def test_contributing_states_the_longest_sentence():
    assert f"at most {LONGEST} words" in (ROOT / "CONTRIBUTING.md").read_text()
