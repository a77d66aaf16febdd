"""`python -m pacnet`: the command line."""

from pacnet.cli import main

raise SystemExit(main())
