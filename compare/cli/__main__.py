"""`python -m compare.cli`, the same as `stratify`."""

from compare.cli import main

if __name__ == "__main__":
    main()
