"""Damage to text: bytes, numbers and words, elements and attributes of XML."""

from __future__ import annotations

import random
import re
import xml.etree.ElementTree as ET

NUMBERS = (
    "0", "-1", "1", "2", "7", "1e308", "-1e308", "1e400", "nan", "inf", "-inf", "1e-320", "4294967296", "-2147483649",
    "1,5", "0x10", "", " ", "1 2 3", "abc", "--1", "1e", "é", "9" * 400,
)  # fmt: skip
WORDS = ("", "x", "world", "true", "base", "../..", "/dev/null", "a b", "é", "A" * 5000, "%s", "&amp;", "0")
_NUMBER = re.compile(rb"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")


def bytes_of(data: bytes, rng: random.Random) -> bytes:
    """Change, remove or insert one to eight bytes, or cut off the end."""
    found = bytearray(data)
    kind = rng.randrange(4)
    if kind == 0:
        return bytes(found[: rng.randrange(len(found))])
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(found))
        if kind == 1:
            found[at] = rng.randrange(256)
        elif kind == 2:
            del found[at : at + rng.choice((1, 4, 40))]
        else:
            found[at:at] = bytes(rng.randrange(256) for _ in range(rng.choice((1, 4, 40))))
        if not found:
            break
    return bytes(found)


def number_of(data: bytes, rng: random.Random) -> bytes:
    """Replace one number by another, or by an invalid one."""
    places = list(_NUMBER.finditer(data))
    place = rng.choice(places)
    return data[: place.start()] + rng.choice(NUMBERS).encode() + data[place.end() :]


def element_of(data: bytes, rng: random.Random) -> bytes:
    """Remove, double, move, rename or change one to three elements or attributes of an XML file."""
    root = ET.fromstring(data)
    for _ in range(rng.choice((1, 1, 2, 3))):
        parents = [(parent, child) for parent in root.iter() for child in parent]
        if not parents:
            break
        parent, child = rng.choice(parents)
        kind = rng.randrange(6)
        if kind == 0:
            parent.remove(child)
        elif kind == 1:
            parent.insert(rng.randrange(len(parent) + 1), child)
        elif kind == 2:
            rng.choice(parents)[1].append(ET.fromstring(ET.tostring(child)))
        elif kind == 3:
            child.tag = rng.choice(parents)[1].tag
        elif child.attrib:
            name = rng.choice(sorted(child.attrib))
            if kind == 4:
                del child.attrib[name]
            else:
                others = [value for _, c in parents for value in c.attrib.values()]
                child.attrib[name] = rng.choice((*NUMBERS, *WORDS, *rng.sample(others, min(8, len(others)))))
    return ET.tostring(root)


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Damage a file in one of these ways."""
    return rng.choice((bytes_of, number_of, element_of, element_of))(data, rng)
