"""``python -m glvis`` is ``glvis``."""

import sys

from glvis.cli import main

sys.exit(main())
