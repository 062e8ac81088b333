"""What is computed from eigenpairs: filters, columns and their truncation, shapes compared."""
