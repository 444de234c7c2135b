"""python -m brake_fenicsx."""

from brake_fenicsx.cli import main

raise SystemExit(main())
