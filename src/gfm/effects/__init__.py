"""One small class per physical law that a model may lack."""
