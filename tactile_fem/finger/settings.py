"""The keys of a finger in a study, and what follows from them without a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from tactile_fem.errors import StudyError
from tactile_fem.finger.plane import PLANES, SPACE, Plane
from tactile_fem.runtime.settings import Either, File, Finite, NonNegative, Positive, Whole

# Lengths that a larger finger of the same shape has larger. Layers of skin are among them: men,
# whose fingers are larger, have a thicker epidermis of the fingertip (Jones et al. 2025,
# DOI 10.1002/ca.24292). Ridges and papillae are not (proposed).
_OF_SIZE = (
    *("half_width_mm", "palmar_height_mm", "dorsal_height_mm", "tip_length_mm"),
    *("straight_length_mm", "contact_from_tip_mm", "pad_radius_mm", "subcutaneous_mm"),
    *("stratum_corneum_mm", "epidermis_mm", "dermis_mm", "nail_thickness_mm"),
    *("bone_half_width_mm", "bone_half_height_mm", "bone_tip_gap_mm"),
    *("nail_width_mm", "nail_length_mm", "pad_size_mm", "far_size_mm"),
)
# Of a section, for each mm of its width: the 0.6 N of the paper over 10 mm, as a contact is wide.
_SECTION_FORCE_N_MM = 0.06


def _not_zero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(vector):
        raise ValueError("must not be the zero vector")
    return vector


Direction = Annotated[tuple[Finite, Finite, Finite], AfterValidator(_not_zero)]


class FingerSettings(Either):
    """Shape of the fingertip and of its mesh."""

    kind: Literal["solid", "section"] = Field(
        "solid", description="the whole fingertip, or a section of it in plane strain"
    )
    plane: Literal["sagittal", "transverse"] = Field(
        "sagittal",
        description="plane of a section through the contact point: along the finger (X = 0) or "
        "across it (Y = 0)",
    )
    preset: Literal["coarse", "medium", "paper"] = Field(
        "coarse", description="mesh size: coarse, medium or paper (81,000 tetrahedra)"
    )
    mesh_file: File | None = Field(
        None,
        description="a .msh file with the package's tags, which gmsh reads, instead of all other "
        "keys of this table but kind",
    )
    skin_file: File | None = Field(
        None,
        description="a scan of the skin (.stl, .obj, .ply), instead of widths and heights; from "
        "a scan of a hand, the finger at contact_mm is taken",
    )
    bone_file: File | None = Field(
        None,
        description="a scan of the bone, in the coordinates of skin_file; without a skin_file "
        "bone_tip_gap_mm and subcutaneous_mm position it",
    )
    nail_file: File | None = Field(
        None, description="a scan of the nail, in the coordinates of skin_file, for its outline"
    )
    file_unit_mm: Positive = Field(
        1.0, description="unit of length of these files in mm; other values scale the finger"
    )
    smooth_mm: NonNegative = Field(
        0.3, description="standard deviation of the Gaussian that smooths the files' surfaces"
    )
    tip_direction: Direction | None = Field(
        None, description="in the files' coordinates; default: the longest axis, to the thin end"
    )
    nail_direction: Direction | None = Field(
        None,
        description="upwards from the stimulator, in the coordinates of the files; default: "
        "towards bone or nail, so that the pad is level where it is touched",
    )
    contact_mm: tuple[Finite, Finite, Finite] | None = Field(
        None,
        description="the point of the skin over the stimulator, in the file's coordinates times "
        "file_unit_mm; default: contact_from_tip_mm, or the lowest point below nail_direction",
    )
    half_width_mm: Positive = Field(8.0, description="proposed: half the finger's width (X)")
    palmar_height_mm: Positive = Field(
        7.2, description="fitted: axis to pad; the radius across is half_width_mm^2 over it"
    )
    dorsal_height_mm: Positive = Field(5.5, description="proposed: axis to nail side")
    tip_length_mm: Positive = Field(11.0, description="proposed: length of the rounded tip (Y)")
    straight_length_mm: Positive = Field(16.0, description="proposed: rounded tip to cut (Y)")
    contact_from_tip_mm: Positive = Field(12.0, description="proposed: tip to contact point")
    pad_radius_mm: Positive = Field(
        29.0, description="fitted: radius of the pad's contour along the finger"
    )
    stratum_corneum_mm: Positive = Field(0.17, description="paper: layer thickness")
    epidermis_mm: Positive = Field(0.65, description="paper: layer thickness")
    dermis_mm: Positive = Field(0.8, description="paper: layer thickness")
    subcutaneous_mm: Positive = Field(
        3.68,
        description="proposed: dermis to bone under the contact point; the paper's nominal 0.7 "
        "leaves too little tissue for its own indentation; to keep the bone in place, subtract "
        "what you add to a layer above it",
    )
    bone_half_width_mm: Positive = Field(4.0, description="proposed")
    bone_half_height_mm: Positive = Field(2.3, description="proposed")
    bone_tip_gap_mm: Positive = Field(6.0, description="proposed: end of the bone to fingertip")
    nail_thickness_mm: Positive = Field(0.5, description="proposed")
    nail_width_mm: Positive = Field(11.0, description="proposed")
    nail_length_mm: Positive = Field(12.0, description="proposed")
    ridge_height_mm: NonNegative = Field(
        0.0, description="of a section's fingerprints, groove to crest; 0: none; people: about 0.1"
    )
    ridge_pitch_mm: Positive = Field(
        0.47, description="distance between ridges; 0.47 in vivo (eLife 93554)"
    )
    papilla_depth_mm: NonNegative = Field(
        0.0,
        description="of a section's epidermis-dermis interface, from the tips of intermediate "
        "ridges to those of papillae, two of each per pitch; 0: none; people: about 0.2",
    )
    papilla_width_mm: Positive = Field(
        0.12, description="width of the dermal papillae at half their height"
    )
    papillae_aligned: bool = Field(
        True,
        strict=True,
        description="an intermediate ridge lies under each crest; false: a papilla does",
    )
    ridged_half_length_mm: Positive = Field(
        6.0, description="extent of ridges and papillae from the contact point"
    )
    pad_size_mm: Annotated[Finite, Field(ge=0.02)] | None = Field(
        None,
        description="element edge under the contact patch; default by preset, in a section a "
        "quarter of it, or an eighth of the pitch of its ridges",
    )
    far_size_mm: Annotated[Finite, Field(ge=0.05)] | None = Field(
        None, description="element edge away from the contact patch; default by preset"
    )
    epidermis_rows: Annotated[Whole, Field(ge=1, le=8)] | None = Field(
        None, description="rows of elements through the epidermis; default by preset"
    )

    def _alternatives(self) -> dict[str, list[str]]:
        together = ["bone_tip_gap_mm", "subcutaneous_mm"] if self.skin_file else []
        return {
            "mesh_file": [
                name for name in type(self).model_fields if name not in ("mesh_file", "kind")
            ],
            "skin_file": ["half_width_mm", "palmar_height_mm", "dorsal_height_mm", "pad_radius_mm"],
            "bone_file": ["bone_half_width_mm", "bone_half_height_mm", *together],
            "nail_file": ["nail_width_mm", "nail_length_mm"],
        }

    @model_validator(mode="after")
    def _files_belong_together(self) -> Self:
        if self.skin_file is None:
            for name in ("nail_file", "contact_mm"):
                if getattr(self, name) is not None:
                    raise ValueError(f"{name} needs a skin_file")
        if self.bone_file and not self.skin_file and not self.nail_direction:
            raise ValueError("bone_file without a skin_file needs nail_direction")
        if not self.is_scanned and (self.tip_direction or self.nail_direction):
            raise ValueError("tip_direction and nail_direction need a skin_file or a bone_file")
        return self

    @model_validator(mode="after")
    def _is_a_section(self) -> Self:
        if self.is_section:
            if self.is_scanned:
                raise ValueError('kind = "section" has no skin_file and bone_file')
            return self
        for name in ("plane", "ridge_height_mm", "papilla_depth_mm"):
            if getattr(self, name) != type(self).model_fields[name].default:
                raise ValueError(f'{name} needs kind = "section"')
        return self

    @staticmethod
    def defaults_beside(given: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
        """Return defaults of other tables, which a section has, from the keys given in all tables.

        It is pressed to a force per width: to the depth of a solid it would be crushed. With ridges
        its equations are factorized: multigrid is poor in many fine rows of elements.
        """
        finger, protocol = (given.get(name, {}) for name in ("finger", "protocol"))
        if finger.get("kind") != "section":
            return {}
        defaults: dict[str, dict[str, Any]] = {}
        if not {"depth_mm", "path"} & protocol.keys():
            defaults["protocol"] = {"force_N": _SECTION_FORCE_N_MM}
        if finger.get("ridge_height_mm") or finger.get("papilla_depth_mm"):
            defaults["solver"] = {"linear": "direct"}
        return defaults

    @property
    def is_section(self) -> bool:
        """Whether it is a plane section."""
        return self.kind == "section"

    @property
    def is_scanned(self) -> bool:
        """Whether skin or bone come from files of triangles."""
        return self.skin_file is not None or self.bone_file is not None

    @property
    def is_parametric(self) -> bool:
        """Whether its lengths alone describe it."""
        return self.mesh_file is None and not self.is_scanned

    @property
    def is_ridged(self) -> bool:
        """Whether it has fingerprints or papillae."""
        return self.ridge_height_mm > 0 or self.papilla_depth_mm > 0

    @property
    def section_plane(self) -> Plane:
        """The plane of a section through the contact point; space for a solid finger."""
        return PLANES[self.plane] if self.is_section else SPACE

    @property
    def force_unit(self) -> str:
        """Forces of a section are per width."""
        return self.section_plane.force_unit

    def require_solid(self, purpose: str) -> None:
        """Raise StudyError if it is a section, and a purpose needs a solid finger."""
        if self.is_section:
            raise StudyError(f'finger.kind is "section" but must be "solid" for {purpose}.')

    def size_keys(self) -> list[tuple[str, ...]]:
        """Return the keys of the lengths that a larger finger of the same shape has larger.

        Edges of elements are among them if they are given. A file of the skin or bone is scaled by
        its unit, with the contact point in it; a mesh from a file has no such keys.
        """
        given = self.model_dump(exclude_none=True)
        keys: list[tuple[str, ...]] = [(name,) for name in _OF_SIZE if name in given]
        if self.is_scanned:
            keys.append(("file_unit_mm",))
            keys += [("contact_mm", str(k)) for k in range(3) if self.contact_mm]
        return keys

    def layer_powers(self, layer: str) -> dict[tuple[str, ...], float]:
        """Return the powers of a layer's thickness and of what makes room for it.

        Subcutaneous tissue does, so that the bone stays where it is (to first order).
        """
        given, key, below = self.model_dump(), f"{layer}_mm", "subcutaneous_mm"
        powers: dict[tuple[str, ...], float] = {(key,): 1.0} if key in given else {}
        if powers and below in given:
            powers[below,] = -getattr(self, key) / self.subcutaneous_mm
        return powers

    @property
    def skin_thickness_mm(self) -> float:
        """Stratum corneum, epidermis and dermis."""
        return self.stratum_corneum_mm + self.epidermis_mm + self.dermis_mm

    @property
    def pad_thickness_mm(self) -> float:
        """Skin surface to bone under the contact point, of the parametric finger."""
        return self.skin_thickness_mm + self.subcutaneous_mm
