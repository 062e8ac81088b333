"""Computations with eigenpairs: filters, features, truncation errors, comparison of shapes."""

#: Kind and number of columns of the features in which vertices are matched by default.
MATCHED_KIND, MATCHED_COLUMNS = "wks", 100
