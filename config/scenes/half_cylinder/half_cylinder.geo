// The surface of the half-cylinder [mm], as its user has it; its mesh is made as a user makes one:
//   gmsh -2 half_cylinder.geo -o half_cylinder.stl      (Gmsh 4.15)
//   arm-brachy mesh half_cylinder.stl half_cylinder.msh --edge-length-mm 8 --scene scene.yaml
// with a scene.yaml of the experiment. Another call gives another mesh, so this one is kept.
SetFactory("OpenCASCADE");
R = 36; L = 100;
Cylinder(1) = {-L/2, 0, 0, L, 0, 0, R};
Box(2) = {-L/2, -R, 0, L, 2*R, R};
BooleanIntersection(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Mesh.MeshSizeMin = 4;
Mesh.MeshSizeMax = 4;
