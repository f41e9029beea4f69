"""Campaigns, vehicles and twins as their YAML files declare them."""
