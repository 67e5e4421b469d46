"""`python -m palpate` is the command `palpate`."""

from palpate.commands import main

main()
