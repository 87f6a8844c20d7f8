// The laboratory's own mesh of the half-cylinder [mm], on which it solves: straight tetrahedra, the
// rims of the pads and the skin of the lump among their faces. Not given to the diagnosis.
//   gmsh -3 laboratory.geo -o laboratory.msh      (Gmsh 4.15)
SetFactory("OpenCASCADE");
R = 36; L = 100;
radius = 8.5;   // of the pads' rims; why not 9: see the README of the experiment
x[] = {-22, 12, 28}; angle[] = {55, -50, 6};    // pads left, right, top: along the axis, off z [deg]
rim = 2.5;      // edge length there
far = 9;        // and away from all
Cylinder(1) = {-L/2, 0, 0, L, 0, 0, R};
Box(2) = {-L/2, -R, 0, L, 2*R, R};
BooleanIntersection(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Sphere(4) = {-18, 12, 17, 12};
round[] = {};
For i In {0:2}
  s = Sin(angle[i]*Pi/180); c = Cos(angle[i]*Pi/180);
  Cylinder(10 + i) = {-L/2, 0, 0, L, 0, 0, R};      // its side is cut to the pad's disc
  Cylinder(20 + i) = {x[i], 0.8*R*s, 0.8*R*c, 0, 0.4*R*s, 0.4*R*c, radius};
  side[] = Boundary{ Volume{10 + i}; };
  round[] += BooleanIntersection{ Surface{side[0]}; }{ Volume{20 + i}; Delete; };
  Recursive Delete { Volume{10 + i}; }
EndFor
BooleanFragments{ Volume{3}; Delete; }{ Surface{round[]}; Volume{4}; Delete; }
e = 1e-3;
left[] = Surface In BoundingBox {-32, 22, 12, -12, 35, 29};
right[] = Surface In BoundingBox {2, -34, 14, 22, -20, 31};
top[] = Surface In BoundingBox {18, -6, 32, 38, 14, R + e};     // in two, by the cylinder's seam
skin[] = Surface In BoundingBox {-30 - e, -e, 5 - e, -6 + e, 24 + e, 29 + e};
base[] = Surface In BoundingBox {-L/2 - e, -R - e, -e, L/2 + e, R + e, e};
ends[] = Surface In BoundingBox {-L/2 - e, -R - e, -e, -L/2 + e, R + e, R + e};
ends[] += Surface In BoundingBox {L/2 - e, -R - e, -e, L/2 + e, R + e, R + e};
side[] = Surface{:};
side[] -= {left[], right[], top[], skin[], base[], ends[]};
lump[] = Volume In BoundingBox {-30 - e, -e, 5 - e, -6 + e, 24 + e, 29 + e};
gel[] = Volume{:};
gel[] -= {lump[]};
Physical Surface("left") = {left[]};
Physical Surface("right") = {right[]};
Physical Surface("top") = {top[]};
Physical Surface("side") = {side[]};
Physical Surface("base") = {base[]};
Physical Surface("skin") = {skin[]};
Physical Volume("lump") = {lump[]};
Physical Volume("gel") = {gel[]};
Field[1] = Distance;
Field[1].CurvesList = {Abs(CombinedBoundary{ Surface{left[]}; }),
                       Abs(CombinedBoundary{ Surface{right[]}; }),
                       Abs(CombinedBoundary{ Surface{top[]}; })};
Field[1].Sampling = 60;
Field[2] = Threshold;
Field[2].InField = 1;
Field[2].SizeMin = rim;
Field[2].SizeMax = far;
Field[2].DistMin = 1;
Field[2].DistMax = 1 + (far - rim) / 0.45;
Field[3] = Distance;
Field[3].SurfacesList = {skin[]};
Field[3].Sampling = 20;
Field[4] = Threshold;
Field[4].InField = 3;
Field[4].SizeMin = 5.5;
Field[4].SizeMax = far;
Field[4].DistMin = 2;
Field[4].DistMax = 2 + (far - 5.5) / 0.4;
Field[5] = Min;
Field[5].FieldsList = {2, 4};
Background Field = 5;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
Mesh.MeshSizeFromCurvature = 0;
Mesh.MshFileVersion = 2.2;
Mesh.RandomSeed = 3;
