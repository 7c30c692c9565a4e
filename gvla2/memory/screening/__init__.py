"""Text that gives orders to machines, in many languages and disguises."""
