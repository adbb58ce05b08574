"""The tensile strip: hyperelastic spring and Maxwell units under a prescribed stretch."""
