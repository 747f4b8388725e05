"""Add the examples to the site: their pictures, and each script as a notebook.

``python docs/hooks/examples.py FOLDER`` writes the notebooks into a folder.
"""

from __future__ import annotations

import ast
import io
import sys
from pathlib import Path
from textwrap import dedent
from typing import Any

from nbformat import v4, writes
from PIL import Image

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
WITHOUT = {"mjx_action", "pose_action", "pushed_arm", "servos", "torques", "weld"}
"""Files without a notebook: one that others import, these scripts, and one with its own URDF."""

_PICTURES = """\
from IPython.display import Image, display

for file in sorted(Path("repctl-out").rglob("*.png")):
    display(Image(file))"""


def notebook(script: Path) -> str:
    """Split a script into notebook cells: docstring, imports, each function, and the main block."""
    text = script.read_text(encoding="utf-8")
    lines, body = text.splitlines(), ast.parse(text).body
    docstring = str(ast.literal_eval(body[0].value)).strip()  # type: ignore[attr-defined]
    summary, _, words = docstring.partition("\n\n")
    title = " ".join(summary.split()).rstrip(".")
    needs = "Requires `repctl_pin`, installed from the folder of the repository or a wheel."
    cells = [v4.new_markdown_cell(f"# {title}\n\n{dedent(words).strip()}\n\n{needs}")]
    pieces: list[str] = []

    def cut() -> None:
        if pieces:
            cells.append(v4.new_code_cell("\n".join(pieces).strip()))
            pieces.clear()

    begin = body[0].end_lineno or 0
    for node in body[1:]:
        end = node.end_lineno or 0
        piece, begin = "\n".join(lines[begin:end]), end
        if isinstance(node, ast.If) and ast.unparse(node.test) == "__name__ == '__main__'":
            cut()
            run = dedent("\n".join(lines[node.body[0].lineno - 1 : end]))
            pieces.append(
                f"import sys\nfrom pathlib import Path\n\nsys.argv = [{script.name!r}]\n{run}"
            )
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            cut()
            pieces.append(piece)
            cut()
        else:
            pieces.append(piece)
    cut()
    if ".savefig(" in text:
        cells.append(v4.new_code_cell(_PICTURES))
    for k, cell in enumerate(cells):
        cell["id"] = f"cell-{k}"  # the same file each time
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return writes(v4.new_notebook(cells=cells, metadata={"kernelspec": kernel})) + "\n"


def scripts() -> list[Path]:
    """List the scripts that become notebooks."""
    return [script for script in sorted(EXAMPLES.glob("*.py")) if script.stem not in WITHOUT]


def thumbnail(picture: Path, width: int = 640) -> bytes:
    """Shrink a picture for the gallery."""
    with Image.open(picture) as whole:
        small = whole.convert("RGB")
    small.thumbnail((width, width), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    small.quantize(128).save(file, format="PNG", optimize=True)
    return file.getvalue()


def on_files(files: Any, *, config: Any) -> Any:
    """Add thumbnails and notebooks to the files of the site."""
    from mkdocs.structure.files import File

    for picture in sorted((EXAMPLES / "pictures").glob("*.png")):
        made = thumbnail(picture)
        files.append(File.generated(config, f"pictures/{picture.name}", content=made))
    for script in scripts():
        files.append(
            File.generated(config, f"notebooks/{script.stem}.ipynb", content=notebook(script))
        )
    return files


def on_page_markdown(text: str, /, **_: object) -> str:
    """Point the links to pictures of examples at the files of the site."""
    text = text.replace("](../../examples/pictures/", "](../pictures/")
    return text.replace("](../examples/pictures/", "](pictures/")


if __name__ == "__main__":
    for source in scripts():
        (Path(sys.argv[1]) / f"{source.stem}.ipynb").write_text(notebook(source), encoding="utf-8")
