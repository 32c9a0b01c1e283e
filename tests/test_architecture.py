"""The house: who may import whom, how fast it opens, and nothing compiled on the way in."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
MAY_IMPORT = {
    "experiment": {"experiment"},
    "ca_model": {"experiment", "ca_model"},
    "continuum": {"experiment", "continuum"},
    "compare": {"experiment", "compare"},
}
PACKAGES = set(MAY_IMPORT)
RUN_MODELS = {"bridge", "campaign", "cli", "explore", "paper", "validation"}


def imported_packages(file: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or "").split(".")[0])
    return found & PACKAGES


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_imports_run_one_way(package: str) -> None:
    """Measurements see archives only; these rooms do more, and diagrams are held to theory."""
    for file in (ROOT / package).rglob("*.py"):
        of_models = file.parent.name in RUN_MODELS or file.match("phase/theory.py")
        allowed = PACKAGES if of_models else MAY_IMPORT[package]
        assert imported_packages(file) <= allowed, file


def test_a_set_up_and_an_archive_know_nothing_of_pours_under_way() -> None:
    files = [*(ROOT / "experiment").glob("*.py"), *(ROOT / "experiment" / "archive").glob("*.py")]
    for file in files:
        assert "experiment.pouring" not in file.read_text(), file


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_every_public_name_is_there(package: str) -> None:
    module = __import__(package)
    assert module.__all__ == sorted(module.__all__)
    assert all(hasattr(module, name) for name in module.__all__)


def test_nothing_is_compiled_or_drawn_at_import() -> None:
    script = (
        "import sys, ca_model, continuum, compare\n"
        "import ca_model.kernel.packets, ca_model.kernel.steps, continuum.kernel\n"
        "import compare.deposit.kernel, compare.kymograph.kernel\n"
        "assert not continuum.kernel.take_steps.signatures\n"
        "assert not ca_model.kernel.packets.follow_packets.signatures\n"
        "assert not ca_model.kernel.steps.take_steps.signatures\n"
        "assert not compare.deposit.kernel.extent.signatures\n"
        "assert not compare.kymograph.kernel.switch.signatures\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "assert 'zarr' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, cwd="/")


def test_kernels_release_the_interpreter_and_are_cached_on_disk() -> None:
    kernels = {
        "ca_model/kernel/packets.py": "follow_packets",
        "ca_model/kernel/steps.py": "take_steps",
        "ca_model/toppling/kernel.py": "advance_toppling",
        "continuum/kernel.py": "take_steps",
        "compare/deposit/kernel.py": "average_along",
        "compare/kymograph/kernel.py": "switch",
    }
    for file, entry in kernels.items():
        source = (ROOT / file).read_text()
        assert re.search(rf"@njit\(cache=True, nogil=True.*\)\ndef {entry}", source)
    for package in ("ca_model", "continuum", "compare"):
        for file in (ROOT / package).rglob("*.py"):
            assert "fastmath" not in file.read_text()
