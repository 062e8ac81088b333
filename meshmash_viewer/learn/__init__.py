"""Learning of vertex classes from labels: feature columns, models and scores."""

from __future__ import annotations

from typing import Literal

Classifier = Literal["ensemble", "forest", "logistic"]
ColumnKind = Literal["hks", "wks", "curvature"]
#: Kinds of classifiers, the default first, with descriptions.
CLASSIFIERS: dict[str, str] = {
    "ensemble": "mean probability of the two others",
    "forest": "100 extremely randomized trees",
    "logistic": "logistic regression of standardized columns",
}
#: Kinds of columns, with descriptions.
KINDS: dict[str, str] = {
    "hks": "logarithm of the heat kernel signature at fixed times",
    "wks": "logarithm of the wave kernel signature at fixed energies",
    "curvature": "curvature, position and normal of the surface smoothed over fixed lengths",
}
