"""Parts of reports beside paragraphs and tables: pictures, and lines to sign."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from hfa_support.reporting.text import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Who signs a book, and what is left blank for a signature.
SIGNERS = ("author", "checked", "approved")
BLANKS = ("name", "date", "signature")


@dataclass(frozen=True, eq=False)
class Picture:
    """Figure in a report, drawn when the report is shown.

    name: name of the picture
    text: description of the picture, for readers who cannot see it
    draw: function that draws the figure
    """

    name: str
    text: str
    draw: Callable[[], Figure]

    @cached_property
    def figure(self) -> Figure:
        """The figure, drawn at the first access."""
        return self.draw()

    @cached_property
    def png(self) -> bytes:
        """Content of a PNG file of the figure."""
        from hfa_support.reporting.figure import png_bytes

        return png_bytes(self.figure)

    def html(self) -> str:
        """Return the figure as HTML with an embedded PNG and its text as caption."""
        import base64
        import html

        data = base64.b64encode(self.png).decode("ascii")
        text = html.escape(printable(self.text, lines=False))
        image = f'<img alt="{text}" src="data:image/png;base64,{data}">'
        return f"<figure>{image}<figcaption>{text}</figcaption></figure>"
