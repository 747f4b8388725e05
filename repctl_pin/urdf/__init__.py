"""Catalogue of known robots, and reading and validation of URDF files."""

from .catalogue import data_folder as data_folder
from .catalogue import default_package_dirs as default_package_dirs
from .catalogue import entries as entries
from .catalogue import find as find
from .catalogue import reference_posture as reference_posture
from .catalogue import table as table
from .catalogue import urdf_folder as urdf_folder
