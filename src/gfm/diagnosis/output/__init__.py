"""What is claimed and written: verdict, names, corrected model."""
