"""`python -m mbvi` is the command `mbvi`."""

from mbvi_command import main

main()
