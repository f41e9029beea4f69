"""What stages hand on as JSON documents, each as a model."""
