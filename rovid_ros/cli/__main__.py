"""What ``python -m rovid_ros.cli`` runs."""

import sys

from rovid_ros.cli.main import main

if __name__ == '__main__':
    sys.exit(main())
