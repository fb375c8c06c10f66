"""Speed and separation monitoring: formulas and distances, without Drake."""
