"""Plots of the spectrum, and the base class of plots."""
