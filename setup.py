"""Refuses an older Python at once: pip would first look for packages that there are not for it."""

import sys

from setuptools import setup

if sys.version_info < (3, 12):  # noqa: UP036
    sys.exit("tactile-fem needs Python >= 3.12: this is {}.{}.".format(*sys.version_info))
setup()
