"""Where one submap lies in another: Hough rotation, translation, refinement, verification, acceptance."""
