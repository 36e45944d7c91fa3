"""The Rust part of mvmatch; each class and function is documented where it is defined."""
