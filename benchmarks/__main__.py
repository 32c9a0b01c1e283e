"""All benchmarks, or those named: `python -m benchmarks [pours] [continuum] [lattice] ...`."""

import sys
from importlib import import_module

SUBJECTS = ("pours", "continuum", "lattice", "solvers")

for subject in sys.argv[1:] or SUBJECTS:
    if subject not in SUBJECTS:
        sys.exit(f"{subject}: no such benchmark; there are {', '.join(SUBJECTS)}")
    module = import_module(f"benchmarks.{subject}")
    print(f"\n== {subject}: {module.__doc__.splitlines()[0]}")
    module.main()
