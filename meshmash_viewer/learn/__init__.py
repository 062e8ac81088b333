"""Classes of vertices, learned from labels: columns, models, scores."""
