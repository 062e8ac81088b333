"""Plot of a functional map: its matrix as an image."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pyqtgraph as pg

from meshmash_viewer.app import theme
from meshmash_viewer.app.plots.plot import Plot

#: Magnitude from which entries have the full colour: those of a refined map are at most 1.
_FULL = 0.5


class MatrixView(Plot):
    """The matrix C of a functional map, in the colours of the first curve where it is negative."""

    def __init__(self, name: str) -> None:
        self._image = pg.ImageItem(axisOrder="row-major")
        #: The matrix that is shown.
        self.matrix = np.zeros((0, 0))
        super().__init__(name, "Matrix of the functional map")
        self.addItem(self._image)
        self.set_whole(True)
        self.getAxis("left").whole = True
        self.plotItem.vb.invertY(True)
        self.set_labels("Eigenfunctions of the second", "Of the first")
        self.setFixedHeight(190)

    def show_matrix(self, matrix: npt.NDArray[np.float64]) -> None:
        """Show a matrix of shape (k, l)."""
        self.matrix = matrix
        self._image.setImage(matrix, levels=(-_FULL, _FULL))
        rows, columns = matrix.shape
        self._image.setRect(-0.5, -0.5, columns, rows)  # entries are at their indices
        self.show_all()

    def dress(self) -> None:
        super().dress()
        palette = theme.palette()
        colors = palette.series[0], palette.surface, palette.series[1]
        ends = [pg.mkColor(each).getRgb()[:3] for each in colors]
        self._image.setColorMap(pg.ColorMap([0.0, 0.5, 1.0], np.array(ends, dtype=np.ubyte)))
