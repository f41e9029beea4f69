"""Commands about models: coefficients of vehicles, and export to simulators."""
