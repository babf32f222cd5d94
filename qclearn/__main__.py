"""`python -m qclearn` is the `qclearn` command."""

from .cli import main

main()
