"""What others would fit instead."""
