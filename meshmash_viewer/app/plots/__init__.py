"""Plots of the spectrum, and their base class."""
