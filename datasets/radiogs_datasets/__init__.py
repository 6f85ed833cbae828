"""Image files, scene loaders, generated ground truth and the committed miniatures."""
