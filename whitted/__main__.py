"""`python -m whitted` is the command `whitted`."""

from .cli import main

main()
