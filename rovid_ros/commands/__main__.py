"""What ``python -m rovid_ros.commands`` runs."""

import sys

from rovid_ros.commands.main import main

if __name__ == '__main__':
    sys.exit(main())
