"""GeoFuse-MV3D: object geometry from calibrated views. So far the contracts that its plugins fill."""
