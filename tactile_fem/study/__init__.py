"""The study: all input of a scan, with the paper's values as defaults.

"The paper" is Hamasaki et al. 2020, DOI 10.1177/1687814020984651. In descriptions, ``paper``
marks values stated in its text and ``proposed`` values chosen by this project.
Lengths are mm, forces N, stresses MPa, times s, currents pA, potentials mV.
"""

from tactile_fem import companions
from tactile_fem.finger import Finger
from tactile_fem.finger.joint import Joint
from tactile_fem.neuron.settings import DEFAULT_NAME, Neuron
from tactile_fem.path import (
    Follow,
    Hold,
    Lift,
    Piece,
    Press,
    Protocol,
    Push,
    Roll,
    Slide,
    Twist,
)
from tactile_fem.receptors.settings import Receptors
from tactile_fem.runtime.lazy import lazily
from tactile_fem.runtime.settings import Settings
from tactile_fem.stimulus import (
    Braille,
    Cylinder,
    Dots,
    Drawing,
    Edge,
    Grating,
    Heights,
    Plate,
    Sphere,
    Stimulus,
    Surface,
    Text,
)
from tactile_fem.study.afferents import Afferents
from tactile_fem.study.explain import in_words, suggestion
from tactile_fem.study.file import dump_study, load_study
from tactile_fem.study.input_copies import content_of, keep_files, with_files
from tactile_fem.study.output import Output
from tactile_fem.study.solver import Solver
from tactile_fem.study.study import AFTER_MECHANICS, Study
from tactile_fem.tissue.constants import TISSUE_SETS, Elastic, Material, Ogden, Polynomial, Tissue

__all__ = [
    "AFTER_MECHANICS",
    "DEFAULT_NAME",
    "TISSUE_SETS",
    "Afferents",
    "Braille",
    "Cylinder",
    "Dots",
    "Drawing",
    "Edge",
    "Elastic",
    "Finger",
    "Follow",
    "Grating",
    "Heights",
    "Hold",
    "Joint",
    "Lift",
    "Material",
    "Neuron",
    "Ogden",
    "Output",
    "Piece",
    "Plate",
    "Polynomial",
    "Press",
    "Protocol",
    "Push",
    "Receptors",
    "Roll",
    "Settings",
    "Slide",
    "Solver",
    "Sphere",
    "Stimulus",
    "Study",
    "Surface",
    "Text",
    "Tissue",
    "Twist",
    "content_of",
    "dump_study",
    "in_words",
    "keep_files",
    "load_study",
    "suggestion",
    "with_files",
]
__all__ += [name for names in companions.names("study_names").values() for name in names]

__getattr__ = lazily("tactile_fem", companions.names("study_names"))
