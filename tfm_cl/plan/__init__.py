"""Every ``"auto"``: where the camera and the light stand, how fine maps and steps are, how a basis fits."""
