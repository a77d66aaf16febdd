"""The paper's earlier system."""
