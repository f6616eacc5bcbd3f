"""Whether a method keeps what every method promises, as Gymnasium's ``check_env`` does for environments."""
