"""Extension of Griffe, which reads the docstrings: shows doctests as code."""

from __future__ import annotations

import re
from typing import Any, Final

from griffe import Extension, Object

DOCTEST: Final = re.compile(r"^( *)>>> .*(?:\n *\S.*)*", re.MULTILINE)


class Doctests(Extension):
    """Puts each doctest of a docstring into a fence; Markdown would take it for a quotation."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Change the docstring of an object that was read."""
        if obj.docstring is not None:
            fence = r"\1```python\n\g<0>\n\1```"
            obj.docstring.value = DOCTEST.sub(fence, obj.docstring.value)
