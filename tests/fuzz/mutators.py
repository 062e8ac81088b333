"""Functions that break files: bit flips, truncation, splices, wrong numbers and counts, bombs.

Each takes a random generator and the content of a file; equal seeds give equal results.
"""

from __future__ import annotations

import gzip
import io
import json
import random
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable

from tests.fuzz.seeds import Seed, glb

#: Maximum size of a broken file (bytes).
LARGEST = 1_000_000

_NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_]{2,24}")
_NUMBERS = (
    *(b"0", b"-0", b"-1", b"1", b"2", b"3", b"4", b"7", b"255", b"256", b"65535", b"65536"),
    *(b"2147483647", b"2147483648", b"-2147483648", b"4294967295", b"4294967296"),
    *(b"9223372036854775807", b"9223372036854775808", b"18446744073709551615", b"9" * 30),
    *(b"1e10", b"1e38", b"3.5e38", b"1e154", b"1e308", b"1e400", b"-1e308", b"1e-320"),
    *(
        b"nan",
        b"inf",
        b"-inf",
        b"",
        b" ",
        b"x",
        b"0x10",
        b"1_000",
        b"1.5",
        b"1e",
        b"-",
        b"9" * 5000,
    ),
    *(b"1000000", b"99999999", b"99999999999", b"null", b"true", b'"1"', b"[]", b"{}"),
)
_BYTES = (b"\0", b"\xff", b"\x7f", b"\x80", b"\n", b" ", b'"', b"<", b"\r\n", b"\\\n", b"#", b"-")
_LIES = (0, 1, 2, 3, 255, 2**15, 2**16 - 1, 2**20, 2**24 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40)


def flip_bits(rng: random.Random, data: bytes) -> bytes:
    broken = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16))):
        broken[rng.randrange(len(broken))] ^= 1 << rng.randrange(8)
    return bytes(broken)


def put_bytes(rng: random.Random, data: bytes) -> bytes:
    for _ in range(rng.choice((1, 1, 2, 5))):
        place = rng.randrange(len(data) + 1)
        odd = rng.choice(_BYTES) * rng.choice((1, 1, 1, 4, 100))
        data = data[:place] + odd + data[place + rng.choice((0, len(odd))) :]
    return data


def truncate(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(1, len(data) + 1)]


def move_parts(rng: random.Random, data: bytes) -> bytes:
    """Remove or repeat a part, or exchange two parts."""
    a, b, c = sorted(rng.randrange(len(data) + 1) for _ in range(3))
    return rng.choice(
        (
            data[:a] + data[b:],
            data[:b] + data[a:],
            data[:a] + data[b:c] + data[a:b] + data[c:],
            data[:b] + data[a:b] * 20 + data[b:],
        )
    )


def change_numbers(rng: random.Random, data: bytes) -> bytes:
    """Replace numbers that are written as text."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        found = list(_NUMBER.finditer(data))
        if not found:
            return flip_bits(rng, data)
        # Half of the changes affect the first 12 numbers, which include the counts in headers.
        number = rng.choice(found[:12] if rng.random() < 0.5 else found)
        data = data[: number.start()] + rng.choice(_NUMBERS) + data[number.end() :]
    return data


def change_words(rng: random.Random, data: bytes) -> bytes:
    """Replace a word by another, or remove, capitalize or repeat it."""
    found = list(_WORD.finditer(data[:20_000]))
    if len(found) < 2:
        return put_bytes(rng, data)
    one, other = rng.choice(found), rng.choice(found)
    word = rng.choice((other[0], other[0], b"", one[0].upper(), one[0] * 300))
    return data[: one.start()] + word + data[one.end() :]


def lie(rng: random.Random, data: bytes) -> bytes:
    """Overwrite bytes with a binary integer, as used for counts and lengths."""
    for _ in range(rng.choice((1, 1, 2))):
        form = rng.choice(("<H", ">H", "<I", ">I", "<I", ">I", "<Q", ">Q"))
        size = struct.calcsize(form)
        if len(data) < size:
            return data + bytes(8)
        last = len(data) - size
        place = rng.randrange(min(last, 200) + 1) if rng.random() < 0.5 else rng.randrange(last + 1)
        value = rng.choice((*_LIES, len(data), len(data) * 10)) % 256**size
        data = data[:place] + struct.pack(form, value) + data[place + size :]
    return data


Mutator = Callable[[random.Random, bytes], bytes]
MUTATORS: tuple[Mutator, ...] = (
    flip_bits,
    put_bytes,
    truncate,
    move_parts,
    change_numbers,
    change_numbers,
    change_words,
    lie,
)


def broken(rng: random.Random, seed: Seed, others: list[Seed]) -> Seed:
    """Return a broken copy of a valid file, sometimes joined with a part of another file."""
    name, data = seed
    if rng.random() < 0.08:
        _, other = rng.choice(others)
        data = data[: rng.randrange(len(data))] + other[rng.randrange(len(other)) :]
    inside = _INSIDE.get(name[name.rindex(".") :])
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        mutator = rng.choice(MUTATORS)
        if inside is not None and rng.random() < 0.6:
            data = inside(rng, data, mutator)
        elif data:
            data = mutator(rng, data)
    return name, (data or b"\0")[:LARGEST]


# Valid containers with broken content ----------------------------------------------------------


def _in_zip(rng: random.Random, data: bytes, mutator: Mutator) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    except Exception:  # noqa: BLE001  already broken
        return mutator(rng, data)
    chosen = rng.randrange(len(members)) if members else -1
    file = io.BytesIO()
    kind = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
    with warnings.catch_warnings(action="ignore"), zipfile.ZipFile(file, "w", kind) as archive:
        for index, (name, content) in enumerate(members):
            if index == chosen and content and rng.random() < 0.9:
                # Only the header of the array (128 bytes) is changed.
                head = min(len(content), 128)
                content = mutator(rng, content[:head]) + content[head:]
            elif index == chosen:
                name = rng.choice(("", "vertices", "a\nb\x1b[31m", "../x.npy", "faces.npy"))
            archive.writestr(zipfile.ZipInfo(name or "x"), content, kind)
    return file.getvalue()


def _in_gzip(rng: random.Random, data: bytes, mutator: Mutator) -> bytes:
    try:
        content = gzip.decompress(data)
    except Exception:  # noqa: BLE001  already broken
        return mutator(rng, data)
    return gzip.compress(mutator(rng, content) if content else b"x", 1, mtime=0)


def _in_glb(rng: random.Random, data: bytes, mutator: Mutator) -> bytes:
    try:
        (length,) = struct.unpack_from("<I", data, 12)
        return glb(mutator(rng, data[20 : 20 + length]), data[28 + length :])
    except Exception:  # noqa: BLE001  already broken
        return mutator(rng, data)


_INSIDE = {".npz": _in_zip, ".gz": _in_gzip, ".glb": _in_glb}


# Small files that require much memory or time ----------------------------------------------------


def bomb(rng: random.Random) -> tuple[str, Seed]:
    """Return a format, and a small file that declares, unpacks to or repeats too much data."""
    kind, make = rng.choice(_BOMBS)
    name, data = make(rng)
    return kind, (name, data[:LARGEST])


def _gzip_bomb(rng: random.Random) -> Seed:
    name, block = rng.choice(
        (
            ("b.obj.gz", b"\n" * 1_000_000),
            ("b.obj.gz", b"v 0 0 0\n" * 125_000),
            ("b.obj.gz", b"f 1 1 1\n" * 125_000),
            ("b.stl.gz", bytes(1_000_000)),
            ("b.stl.gz", b"solid" + b"vertex\n" * 140_000),
            ("b.ply.gz", b"ply\nformat ascii 1.0\nelement vertex 9\n" + b"comment a\n" * 100_000),
            ("b.off.gz", b"OFF\n" + b"0\n" * 500_000),
            ("lh.pial.gz", b"\xff\xff\xfe\n\n" + b"\1" * 999_995),
            ("b.vtk.gz", b"# vtk DataFile Version 3.0\n" + b"a" * 999_973),
            ("b.gii.gz", b"<GIFTI>" + b"<DataArray/>" * 83_000),
        )
    )
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    size = rng.choice((1, 5, 12, 30, 100, 300, 900))
    return name, b"".join(packer.compress(block) for _ in range(size)) + packer.flush()


def _zip_bomb(rng: random.Random) -> Seed:
    n = rng.choice((10**5, 10**6, 10**7, 3 * 10**7))
    honest = rng.random() < 0.5
    header = {"descr": rng.choice(("<f8", "<f4", "|u1")), "fortran_order": False, "shape": (n, 3)}
    text = (str(header) + " " * 100)[:117].encode() + b"\n"
    magic = b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("vertices.npy", "w", force_zip64=True) as member:
            member.write(magic)
            for _ in range(3 * n * int(header["descr"][-1]) // 1_000_000 if honest else 1):
                member.write(bytes(1_000_000))
        archive.writestr("faces.npy", magic.replace(b"f", b"i") + bytes(24))
    return "b.npz", file.getvalue()


def _ply_bomb(rng: random.Random) -> Seed:
    head = "ply\nformat binary_little_endian 1.0\n"
    points = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    rows = rng.choice((10_000, 200_000, 900_000))
    name = rng.choice(("face", "tristrips"))
    faces = f"element {name} {rows}\nproperty list uchar {rng.choice(('uchar', 'int'))} "
    faces += "vertex_indices\nend_header\n"
    body = struct.pack("<12f", *range(12)) + rng.choice((b"\0", b"\1\0", b"\0\1\0")) * rows
    many = "".join(f"property uchar p{i}\n" for i in range(rng.choice((3, 20_000))))
    return "b.ply", (head + points + many + faces).encode() + body


def _stl_bomb(rng: random.Random) -> Seed:
    n = rng.choice((2_000, 19_000))
    corners = [rng.random() * rng.choice((1.0, 1e-30)) for _ in range(9 * n)]
    corners[0] = rng.choice((1e38, 1e8, 3.4e38, 1.0))
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *corners[i : i + 9], 0) for i in range(0, len(corners), 9)
    )
    return "b.stl", bytes(80) + struct.pack("<I", n) + body


def _gltf_bomb(rng: random.Random) -> Seed:
    n = rng.choice((100, 3_000, 12_000))
    used = {"bufferView": 0, "componentType": 5126, "count": 20_000, "type": "VEC3"}
    primitive = {"attributes": {"POSITION": 0}}
    kind = rng.choice(("primitives", "nodes", "chain", "views", "deep", "ring"))
    scene = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": list(range(n)) if kind == "nodes" else [0]}],
        "nodes": [{"mesh": 0}] * (n if kind == "nodes" else 1),
        "meshes": [{"primitives": [primitive] * (n if kind == "primitives" else 1)}],
        "accessors": [used],
        "bufferViews": [{"buffer": 0, "byteLength": 240_000}] * (n if kind == "views" else 1),
        "buffers": [{"byteLength": 240_000}],
    }
    if kind in ("chain", "ring"):
        scene["nodes"] = [{"children": [(i + 1) % n], "mesh": 0} for i in range(n)]
        if kind == "chain":
            scene["nodes"][-1].pop("children")
    text = json.dumps(scene).encode()
    if kind == "deep":
        text = b'{"nodes":' + b"[" * 300_000
    return "b.glb", glb(text, bytes(240_000))


def _gifti_bomb(rng: random.Random) -> Seed:
    n = rng.choice((1_000, 10**6, 3 * 10**8))
    array = (
        '<DataArray Intent="NIFTI_INTENT_POINTSET" DataType="NIFTI_TYPE_FLOAT32"'
        f' ArrayIndexingOrder="RowMajorOrder" Dimensionality="{{}}" Dim0="{n}" Dim1="3"'
        ' Encoding="GZipBase64Binary" Endian="LittleEndian">'
    )
    import base64

    packer = zlib.compressobj(9)
    packed = b"".join(packer.compress(bytes(1_000_000)) for _ in range(rng.choice((1, 100, 700))))
    data = base64.b64encode(packed + packer.flush()).decode()
    entities = "".join(f'<!ENTITY e{i + 1} "{f"&e{i};" * 10}">' for i in range(9))
    text = rng.choice(
        (
            f'<GIFTI Version="1.0">{array.format(99999999999)}</DataArray></GIFTI>',
            f'<GIFTI Version="1.0">{array.format(2)}<Data>{data}</Data></DataArray></GIFTI>',
            f'<GIFTI Version="1.0">{"<DataArray/>" * 80_000}</GIFTI>',
            f"<GIFTI>{'<MetaData>' * 90_000}",
            f'<!DOCTYPE GIFTI [<!ENTITY e0 "aaaaaaaaaa">{entities}]><GIFTI>&e9;</GIFTI>',
        )
    )
    return "b.gii", text.encode()


def _vtk_bomb(rng: random.Random) -> Seed:
    n = rng.choice((10**4, 10**6, 10**8, 2 * 10**9, 2**32 - 1, 2**62))
    head = "# vtk DataFile Version 3.0\nb\nASCII\nDATASET "
    text = rng.choice(
        (
            f"{head}POLYDATA\nPOINTS {n} float\n0 0 0\n",
            f"{head}POLYDATA\nPOINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS {n} {n}\n3 0 1 2\n",
            f"{head}POLYDATA\npoints {n} double\n0 0 0\n",
            f"{head}STRUCTURED_POINTS\nDIMENSIONS {n} {n} 1\nORIGIN 0 0 0\nSPACING 1 1 1\n",
            f"{head}RECTILINEAR_GRID\nDIMENSIONS {n} 1 1\nX_COORDINATES {n} float\n0 1\n",
            f"{head}POLYDATA\nFIELD FieldData 1\nx {n} {n} float\n0 0 0\n",
            f"{head}POLYDATA\nFIELD FieldData {n}\nx 1 1 float\n0\n",
            f"{head}UNSTRUCTURED_GRID\nPOINTS 3 float\n0 0 0 1 0 0 0 1 0\nCELLS 1 4\n3 0 1 2\n"
            f"CELL_TYPES {n}\n5\n",
            f"{head}POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA {n}\nSCALARS a float\n"
            "LOOKUP_TABLE default\n0\n",
            f"{head}POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA 1\nSCALARS a float {n}\n"
            f"LOOKUP_TABLE t\n0\nLOOKUP_TABLE t {n}\n0 0 0 0\n",
        )
    )
    return "b.vtk", text.encode()


def _vtp_bomb(rng: random.Random) -> Seed:
    n = rng.choice((10**4, 10**5, 10**6, 10**8, 2**31 - 1, 2**32 - 1, 2**62))
    components, points, tuples = (n if rng.random() < 0.5 else 3 for _ in range(3))
    padding = "<!--" + "a" * rng.choice((0, 900_000)) + "-->"
    text = (
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian"'
        f' header_type="UInt64"><PolyData>{padding}<FieldData><DataArray type="Float32"'
        f' Name="f" NumberOfTuples="{tuples}" format="ascii">1 2 3</DataArray></FieldData>'
        f'<Piece NumberOfPoints="{points}" NumberOfPolys="1"><Points>'
        f'<DataArray type="Float32" NumberOfComponents="{components}" format="ascii">'
        "0 0 0 1 0 0 0 1 0</DataArray></Points><Polys>"
        '<DataArray type="Int64" Name="connectivity" format="ascii">0 1 2</DataArray>'
        f'<DataArray type="Int64" Name="offsets" format="ascii">{rng.choice((3, n))}'
        "</DataArray></Polys></Piece></PolyData></VTKFile>"
    )
    return "b.vtp", text.encode()


def _line_bomb(rng: random.Random) -> Seed:
    n = rng.choice((10_000, 999_000))
    head = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    return rng.choice(
        (
            ("b.obj", b"\n" * n),
            ("b.obj", head + b"f" + b" 1 2 3" * (n // 6) + b"\n"),
            ("b.obj", head + b"f 1 2 3\n" * (n // 8) + b"f 1 2 3 9/"),
            ("b.obj", head + b" " * n),
            ("b.obj", head + b"\\\n" * (n // 2) + b"f 1 2 x"),
            ("b.obj", head + b"f 1 2 3" + b"/" * n),
            ("b.off", b"OFF " + b"#" * n),
            ("b.off", b"OFF\n3 " + str(n).encode() + b" 0\n0 0 0\n1 0 0\n0 1 0\n" + b"0\n" * n),
            ("b.stl", b"solid a\n" + b"facet normal\nvertex\n" * (n // 20)),
            ("b.stl", b"solid " + b" " * n),
            ("lh.pial", b"\xff\xff\xfe" + b"a" * n),
        )
    )


_BOMBS: tuple[tuple[str, Callable[[random.Random], Seed]], ...] = (
    ("gzip", _gzip_bomb),
    ("gzip", _gzip_bomb),
    ("npz", _zip_bomb),
    ("ply", _ply_bomb),
    ("stl", _stl_bomb),
    ("gltf", _gltf_bomb),
    ("gifti", _gifti_bomb),
    ("vtk", _vtk_bomb),
    ("vtp", _vtp_bomb),
    ("text", _line_bomb),
)
