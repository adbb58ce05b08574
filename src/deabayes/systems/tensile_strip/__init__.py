"""The tensile strip: a hyperelastic spring and Maxwell units under a prescribed stretch."""
