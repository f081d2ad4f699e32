"""The Python reference of the site: each public name has an entry."""

import re

import codegen
import codegen.runtime
import codegen.symbolic
from codegen.runtime.sections import SHARED

PAGES = SHARED.parent / "docs" / "reference"


def test_every_public_name_has_an_entry():
    text = "\n".join(page.read_text(encoding="utf-8") for page in sorted(PAGES.glob("*.md")))
    entries = {
        name.rpartition(".")[2] for name in re.findall(r"^\.\. auto(?:function|class|exception):: (\S+)$", text, re.M)
    }
    public = {*codegen.__all__, *codegen.runtime.__all__, *codegen.symbolic.__all__} - {"__version__"}
    assert not public - entries, sorted(public - entries)
    # these modules import their names when they are read, so automodule would list none of them
    assert "automodule" not in text
