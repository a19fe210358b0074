"""Reads Gmsh .msh files 2, 4.0 and 4.1, text and binary, with any option of gmsh for saving.

Elements may belong to no physical group (``Mesh.SaveAll``) or to several, nodes may carry the
parameters of their surface (``Mesh.SaveParametric``), and a name may belong to groups of two
dimensions; meshio reads none of these.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_fem.finger.plane import Array
from tactile_fem.finger.simplex import Indices
from tactile_fem.runtime.text import Numbers

_SECTION = re.compile(rb"^[ \t]*\$(\w+)[ \t\r]*\n", re.MULTILINE)
_GROUP = re.compile(rb'(\d+)\s+(-?\d+)\s+"(.*)"')
# By type of element in gmsh, from the line (1) to the tetrahedron with 56 nodes (31), and higher.
_NODES = [2, 3, 4, 4, 8, 6, 5, 3, 6, 9, 10, 27, 18, 14, 1, 8, 20, 15, 13, 9, 10, 12, 15, 15, 21, 4]
_NODES_OF = dict(enumerate([*_NODES, 5, 6, 20, 35, 56], 1)) | {92: 64, 93: 125}


class Block(NamedTuple):
    """Elements of one type."""

    kind: int
    nodes: Indices  # (m, n)
    groups: Indices  # (m, k) physical groups of this dimension; 0 is none


class MshFile:
    """The content of a .msh file.

    Raises OSError if it cannot be read; ValueError, from its methods as well, if it is no .msh
    file, cut off, or of another version.
    """

    def __init__(self, file: Path) -> None:
        data = file.read_bytes()
        self._sections: dict[str, bytes] = {}
        at = 0
        while found := _SECTION.search(data, at):
            end = data.find(b"$End" + found[1], found.end())
            if end < 0:
                raise ValueError(f"${found[1].decode()} has no end")
            self._sections.setdefault(found[1].decode(), data[found.end() : end])
            at = data.find(b"\n", end) + 1 or len(data)
        head = self._section("MeshFormat")
        version, binary, size = head.split(maxsplit=3)[:3]
        self._version, self._text = float(version), binary == b"0"
        if not 2 <= self._version < 5:
            raise ValueError(f"its version is {self._version:g}, not 2 or 4")
        self._order = ">" if head.partition(b"\n")[2][:4] == b"\0\0\0\1" else "<"
        # Of counts and, in 4.1, of numbers of nodes and elements.
        self._size = f"u{int(size)}" if self._version > 4 else "u8"

    def names(self) -> dict[tuple[int, int], str]:
        """Return the names of the physical groups by dimension and number."""
        found = _GROUP.findall(self._sections.get("PhysicalNames", b""))
        return {(int(d), abs(int(tag))): name.decode(errors="replace") for d, tag, name in found}

    def content(self) -> tuple[Array, list[Block]]:
        """Return the coordinates (n, 3) of the nodes, and the elements by indices of nodes."""
        old = self._version < 4
        tags, points = self._nodes_2() if old else self._nodes_4()
        index = np.full(tags.max(initial=0) + 1, -1)
        index[tags] = np.arange(len(tags))
        blocks = []
        for block in self._blocks_2() if old else self._blocks_4():
            known = (block.nodes >= 0) & (block.nodes < len(index))
            nodes = index[np.where(known, block.nodes, 0)]
            if not known.all() or (nodes < 0).any():
                raise ValueError("elements have nodes that it does not contain")
            blocks.append(Block(block.kind, nodes, np.abs(block.groups)))
        return points, blocks

    # --- version 2 -------------------------------------------------------------------------------

    def _nodes_2(self) -> tuple[Indices, Array]:
        if "ParametricNodes" in self._sections:
            count, numbers = self._counted("ParametricNodes")
            return _loose_nodes(numbers, count)
        count, numbers = self._counted("Nodes")
        node = np.dtype([("tag", numbers.type_of("i4")), ("x", numbers.type_of("f8"), (3,))])
        rows = numbers.take(node, count)
        return rows["tag"].astype(np.int64), rows["x"].astype(float)

    def _blocks_2(self) -> Iterator[Block]:
        count, numbers = self._counted("Elements")
        while count > 0:
            if self._text:  # records of a number, type, number of tags, tags and nodes
                _, kind, tags = numbers.peek("i4", 3).astype(np.int64).tolist()
                own, width = numbers.type_of("i4"), tags + _nodes_of(kind)
                fields = [(name, own) for name in ("number", "kind", "tags")]
                record = np.dtype([*fields, ("tags and nodes", own, (width,))])
                rows = numbers.alike(record, count, {"kind": kind, "tags": tags})
                rows = rows["tags and nodes"].astype(np.int64)
            else:
                kind, run, tags = numbers.integers("i4", 3).tolist()
                rows = numbers.rows("i4", run, 1 + tags + _nodes_of(kind))[:, 1:]
            yield Block(kind, rows[:, tags:], rows[:, : min(tags, 1)])
            count -= len(rows)

    # --- version 4 -------------------------------------------------------------------------------

    def _nodes_4(self) -> tuple[Indices, Array]:
        numbers, new = self._numbers("Nodes"), self._version > 4
        tags, points = [], []
        for _ in range(numbers.integers(self._size, 4 if new else 2)[0]):
            one, other, parametric = numbers.integers("i4", 3)
            (count,) = numbers.integers(self._size)
            if new:
                width = 3 + (one if parametric else 0)
                own = numbers.integers(self._size, count)
                at = numbers.take("f8", count * width).reshape(count, width)[:, :3]
            else:
                own, at = _loose_nodes(numbers, count, other if parametric else 0)
            tags.append(own)
            points.append(at)
        return np.concatenate(tags), np.concatenate(points)

    def _blocks_4(self) -> Iterator[Block]:
        groups = self._groups()
        numbers, new = self._numbers("Elements"), self._version > 4
        for _ in range(numbers.integers(self._size, 4 if new else 2)[0]):
            one, other, kind = numbers.integers("i4", 3).tolist()
            (count,) = numbers.integers(self._size)
            rows = numbers.rows(self._size if new else "i4", count, 1 + _nodes_of(kind))
            own = groups.get((one, other) if new else (other, one), np.zeros(0, np.int64))
            yield Block(kind, rows[:, 1:], np.tile(own, (count, 1)))

    def _groups(self) -> dict[tuple[int, int], Indices]:
        """Return the physical groups of each entity, by its dimension and number."""
        found = {}
        for section in {"Entities", "PartitionedEntities"} & self._sections.keys():
            numbers, parts = self._numbers(section), section == "PartitionedEntities"
            if parts:
                _, ghosts = numbers.integers(self._size, 2)
                numbers.integers("i4", 2 * ghosts)
            for dim, count in enumerate(numbers.integers(self._size, 4)):
                for _ in range(count):
                    (tag,) = numbers.integers("i4")
                    if parts:
                        numbers.integers("i4", 2)
                        self._listed(numbers)
                    numbers.take("f8", 3 if dim == 0 and self._version > 4 else 6)
                    found[dim, tag] = self._listed(numbers)
                    if dim:
                        self._listed(numbers)
        return found

    def _listed(self, numbers: Numbers) -> Indices:
        """Return the integers of a list that begins with their count."""
        return numbers.integers("i4", numbers.integers(self._size)[0])

    # --- sections --------------------------------------------------------------------------------

    def _section(self, name: str) -> bytes:
        if name not in self._sections:
            raise ValueError(f"it has no section ${name}")
        return self._sections[name]

    def _numbers(self, section: str) -> Numbers:
        return Numbers(self._section(section), self._text, self._order)

    def _counted(self, section: str) -> tuple[int, Numbers]:
        """Return the count in the first line of a section, and its numbers."""
        count, _, data = self._section(section).partition(b"\n")
        return int(count), Numbers(data, self._text, self._order)


def _loose_nodes(
    numbers: Numbers, count: int, parameters: int | None = None
) -> tuple[Indices, Array]:
    """Take nodes with parameters, as many as their entity has dimensions, which may follow them."""
    tags, points = [], []
    for _ in range(count):
        tags += numbers.integers("i4").tolist()
        points.append(numbers.take("f8", 3))
        dim = int(numbers.integers("i4", 2)[0]) if parameters is None else parameters
        numbers.take("f8", dim if dim < 3 else 0)
    return np.array(tags, dtype=np.int64), np.reshape(points, (-1, 3))


def _nodes_of(kind: int) -> int:
    """Return the number of nodes of a type of elements."""
    if kind not in _NODES_OF:
        raise ValueError(f"elements of gmsh's type {kind} are unknown")
    return _NODES_OF[kind]
