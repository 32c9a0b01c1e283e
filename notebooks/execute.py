"""Run the notebooks, and keep their outputs in them: `make notebooks`.

    python notebooks/execute.py [NAME ...]    all of them, or those named, as in 1-first-pour

What a run leaves beside its outputs, such as times and the kernel's version, is not kept, so that
a file changes only where its outputs do. Pictures are kept in 256 colours, a third of the size,
chosen to cover all that a picture has: a thin line keeps its colour beside large areas of others.
"""

import base64
import io
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).parent
MOST_SECONDS = 120  # a cell
COLOURS = 256
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def executed(path: Path) -> nbformat.NotebookNode:
    """The notebook at `path` after a run from top to bottom, in a folder of its own.

    Raises :class:`nbclient.exceptions.CellExecutionError` where a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    with TemporaryDirectory() as folder:
        NotebookClient(
            notebook,
            timeout=MOST_SECONDS,
            kernel_name="python3",
            record_timing=False,
            coalesce_streams=True,
            resources={"metadata": {"path": folder}},
        ).execute()
    notebook["metadata"] = nbformat.from_dict(METADATA)
    return notebook


def small(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook with its pictures in few colours."""
    for cell in notebook["cells"]:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                picture = Image.open(io.BytesIO(base64.b64decode(data["image/png"])))
                file = io.BytesIO()
                few = picture.convert("RGB").quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
                few.save(file, "png", optimize=True)
                data["image/png"] = base64.b64encode(file.getvalue()).decode()
    return notebook


def main(names: list[str]) -> None:
    for path in sorted(FOLDER.glob("*.ipynb")):
        if not names or path.stem in names:
            nbformat.write(small(executed(path)), path)
            print(path.name)


if __name__ == "__main__":
    main(sys.argv[1:])
