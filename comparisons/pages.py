"""What the HTML pages share: templates, one style, pictures inside the page, whole files."""

from __future__ import annotations

import base64
import os
import re
import tempfile
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from comparisons.drawing import render
from navopt.errors import StoreError

__all__ = ["MAP_DPI", "data_source", "environment", "inline_picture", "style", "write_text"]

#: Dots per inch of pictures that go into a page as PNG, such as maps.
MAP_DPI = 130


def environment() -> Environment:
    """Templates of this package, strict about names."""
    return Environment(
        loader=PackageLoader("comparisons"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def style(environment: Environment) -> str:
    """Style sheet of the study's report, so that all pages look alike."""
    loader = environment.loader
    assert loader is not None
    source, _, _ = loader.get_source(environment, "report.html.j2")
    found = re.search(r"<style>\n(.*?)</style>", source, re.DOTALL)
    return found[1] if found else ""


def data_source(drawn: bytes, format: str = "svg") -> str:
    """Picture as an address that holds its bytes."""
    kind = "svg+xml" if format == "svg" else format
    return f"data:image/{kind};base64,{base64.b64encode(drawn).decode('ascii')}"


def inline_picture(figure: Figure, alt: str, caption: str, *, format: str = "svg") -> dict[str, str]:
    """Figure for a template: its source with all bytes, the text in its place, and the caption."""
    drawn = render(figure, format=format, dpi=MAP_DPI)
    return {"source": data_source(drawn, format), "alt": alt, "caption": caption}


def write_text(path: Path, text: str) -> None:
    """Replace a file as a whole."""
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(descriptor, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)  # mkstemp's files are the owner's alone
        os.replace(temporary, path)
    except OSError as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        raise StoreError(
            f"path: cannot write {path} ({error.strerror}); give a folder you may write to"
        ) from error
