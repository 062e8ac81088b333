"""A plug-in: spectral graph wavelet signatures, text files of Medit, tables with tabs."""

from dataclasses import dataclass

import numpy as np

import meshmash_viewer as mv
from meshmash_viewer.fields.bank_columns import BankColumns
from meshmash_viewer.units import format_quantity, named_quantity


def wavelet_bank(eigenvalues, count):
    """Filters s λ exp(1 - s λ), each 1 where λ is 1/s, which runs through the spectrum."""
    nonzero = eigenvalues[eigenvalues > 1e-9 * eigenvalues[-1]]
    if not len(nonzero):
        raise mv.InputError("Wavelets need an eigenvalue above zero: compute more of them.")
    centres = np.geomspace(nonzero[0], nonzero[-1], count)

    def response(values):
        scaled = values / centres[:, np.newaxis]
        return scaled * np.exp(1.0 - scaled)

    columns = tuple(f"wavelet_{at}" for at in range(count))
    return mv.FilterBank("wavelets", columns, centres, "Centre", -2, response)


@dataclass(frozen=True)
class Wavelets(BankColumns):
    """One wavelet a column, from long waves to short ones."""

    name = "wavelets"
    label = "Wavelet signature"
    short = "Wavelets"
    tip = "Mexican-hat wavelets, evenly spaced in log λ"
    export = "wavelets"
    position = ("index",)

    def bank(self, eigenvalues, area=None, bound=None):
        return wavelet_bank(eigenvalues, self.count)

    def places(self, spectrum):
        return np.log10(self.bank(spectrum.eigenvalues).parameters)

    def quantity(self, spectrum, unit):
        return f"λ = {format_quantity(10.0 ** self.place(spectrum), unit, -2)}"

    def axes(self, unit):
        return named_quantity("log₁₀ λ, λ", unit, -2), named_quantity("Wavelets", unit, -2)

    def bank_script(self):
        arguments = f"decomposition.eigenvalues, {self.count}"
        return f'__import__("meshmash_wavelets").wavelet_bank({arguments})'


def read_medit(path):
    """Vertices and triangles of a text file of Medit, whose indices begin with 1."""
    words = path.read_text().split()

    def rows(keyword):
        at = words.index(keyword)
        count = int(words[at + 1])
        return np.array(words[at + 2 : at + 2 + 4 * count], dtype=float).reshape(count, 4)

    vertices, triangles = rows("Vertices"), rows("Triangles")
    return mv.Mesh(vertices[:, :3], triangles[:, :3].astype(np.int64) - 1, unit="mm")


def write_tsv(path, table):
    """One row a vertex; `table.mesh` and, as JSON, `table.meta` could be written as well."""
    np.savetxt(path, table.values, delimiter="\t", header="\t".join(table.columns), comments="")
