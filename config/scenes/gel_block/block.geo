// The gel block, 120 x 90 x 60 mm, with the squares of both pads on its surface [mm]:
//   gmsh -3 block.geo -o block.msh      (Gmsh 4.15)
SetFactory("OpenCASCADE");
rim = 6;    // edge length at the rims of the pads
far = 15;   // and away from them
Box(1) = {-60, -45, 0, 120, 90, 60};
Point(101) = {60, -8, 16};  Point(102) = {60, 20, 16};
Point(103) = {60, 20, 44};  Point(104) = {60, -8, 44};
Point(105) = {-24, 45, 16}; Point(106) = {4, 45, 16};
Point(107) = {4, 45, 44};   Point(108) = {-24, 45, 44};
Line(101) = {101, 102}; Line(102) = {102, 103}; Line(103) = {103, 104}; Line(104) = {104, 101};
Line(105) = {105, 106}; Line(106) = {106, 107}; Line(107) = {107, 108}; Line(108) = {108, 105};
Curve Loop(101) = {101, 102, 103, 104}; Plane Surface(101) = {101};
Curve Loop(102) = {105, 106, 107, 108}; Plane Surface(102) = {102};
BooleanFragments{ Volume{1}; Delete; }{ Surface{101, 102}; Delete; }
e = 1e-3;
pad_a[] = Surface In BoundingBox {60 - e, -8 - e, 16 - e, 60 + e, 20 + e, 44 + e};
pad_b[] = Surface In BoundingBox {-24 - e, 45 - e, 16 - e, 4 + e, 45 + e, 44 + e};
base[] = Surface In BoundingBox {-60 - e, -45 - e, -e, 60 + e, 45 + e, e};
Physical Surface("pad_a") = {pad_a[]};
Physical Surface("pad_b") = {pad_b[]};
Physical Surface("base") = {base[]};
Physical Volume("gel") = Volume{:};
Field[1] = Distance;
Field[1].CurvesList = {Abs(Boundary{ Surface{pad_a[]}; }), Abs(Boundary{ Surface{pad_b[]}; })};
Field[1].Sampling = 40;
Field[2] = Threshold;
Field[2].InField = 1;
Field[2].SizeMin = rim;
Field[2].SizeMax = far;
Field[2].DistMin = 3;
Field[2].DistMax = 22;
Background Field = 2;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
Mesh.MeshSizeFromCurvature = 0;
Mesh.MshFileVersion = 2.2;
Mesh.OptimizeNetgen = 1;
