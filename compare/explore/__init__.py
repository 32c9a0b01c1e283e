"""A page to play with: both models of one pour, side by side, for a class and the curious.

`desk` is what one visitor does: `knobs` of a set-up, `pours` of both models, a `clock`, a
`prediction`; nothing there knows of a browser. `view` draws piles, `words` says what is seen,
`page` puts both before the visitor, and `server` before all of them. The latter four need Panel,
`pip install 'stratify[explore]'`, and are imported by whoever serves.
"""

from compare.explore.desk import Desk, Stage, presets

__all__ = ["Desk", "Stage", "presets"]
