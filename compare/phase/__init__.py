"""Phase diagrams: what both models do over fields of a set-up, with theory's boundary beside it.

`axes` says what varies, `plan` what is to be done for it, `journal` keeps what is done; `diagram`
makes of it one Dataset, in which `boundary` finds where a regime ends and which `figure` draws.
"""

from compare.phase.diagram import phase, phase_to_file

__all__ = ["phase", "phase_to_file"]
