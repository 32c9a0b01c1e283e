"""What the pours cost; run with `make bench`."""
