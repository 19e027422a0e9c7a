"""Drive faults from kinematic residuals: which wheel, steering or sensor lies."""
