"""Agents and controllers outside this package: Bladed libraries, OpenFAST models, ONNX, a ROSCO server."""
