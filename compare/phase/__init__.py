"""Phase diagrams: what both models do over fields of a set-up, with theory's boundary beside it.

`axes` says what varies, `plan` what is to be done for it, and `journal` keeps what is done;
`findings` makes one Dataset of it, with the `boundary` that was measured and that of `theory`;
`diagram` does all that, `figure` draws it by its `patterns`, `summary` puts it in a table.
"""

from compare.phase.diagram import phase, phase_to_file
from compare.phase.figure import draw_phase

__all__ = ["draw_phase", "phase", "phase_to_file"]
