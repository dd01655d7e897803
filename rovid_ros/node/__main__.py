"""What ``python -m rovid_ros.node`` runs."""

import sys

from rovid_ros.node.main import main

if __name__ == '__main__':
    sys.exit(main())
