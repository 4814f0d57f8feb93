"""Design of linear optimal pitch for a turbine: recordings, the model of the plant, the feedback."""
