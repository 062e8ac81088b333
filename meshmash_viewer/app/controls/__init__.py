"""Controls for panels and dialogs."""
